"""The film: for each pixel the sums that give mean, variance and number of samples.

Sums are in double precision and samples are added one at a time, so that any split into passes gives the same bits and
a hundred thousand samples lose no precision.
"""

import warp as wp


@wp.struct
class FilmData:
    """Row-major arrays, one entry per pixel.

    `rays` and `rejected` are for reports: rays traced, and samples that were not finite and count as black.
    """

    total: wp.array(dtype=wp.vec3d)
    total_of_squares: wp.array(dtype=wp.vec3d)
    count: wp.array(dtype=wp.int32)
    rays: wp.array(dtype=wp.int64)
    rejected: wp.array(dtype=wp.int32)


@wp.func
def is_finite_color(c: wp.vec3) -> bool:
    """Return whether all channels are finite."""
    return wp.isfinite(c[0]) and wp.isfinite(c[1]) and wp.isfinite(c[2])


@wp.kernel(enable_backward=False)
def film_noise(
    first_row: int,
    width: int,
    film: FilmData,
    mean_out: wp.array(dtype=wp.float64),
    error_out: wp.array(dtype=wp.float64),
):
    """Sum the pixels' means, and the standard errors of these, over each row and all channels."""
    row = first_row + wp.tid()
    mean = wp.float64(0.0)
    error = wp.float64(0.0)
    for x in range(width):
        pixel = row * width + x
        n = wp.float64(film.count[pixel])
        if n > wp.float64(1.0):
            total = film.total[pixel]
            squares = film.total_of_squares[pixel]
            for c in range(3):
                m = total[c] / n
                mean += m
                variance = wp.max(squares[c] / n - m * m, wp.float64(0.0)) / (n - wp.float64(1.0))
                error += wp.sqrt(variance)
    mean_out[row] = mean
    error_out[row] = error


@wp.kernel(enable_backward=False)
def film_mean(
    first_thread: int,
    total: wp.array(dtype=wp.vec3d),
    count: wp.array(dtype=wp.int32),
    mean_out: wp.array(dtype=wp.vec3),
):
    """Write the mean of each pixel's samples; black where there are none."""
    pixel = first_thread + wp.tid()
    n = wp.float64(wp.max(count[pixel], 1))
    mean = total[pixel] / n
    mean_out[pixel] = wp.vec3(float(mean[0]), float(mean[1]), float(mean[2]))


PIXELS_OF_TALLY = 256
"""Consecutive pixels that a thread of `film_tally` counts."""


@wp.kernel(enable_backward=False)
def film_tally(
    first_thread: int,
    pixels: int,
    film: FilmData,
    counted: wp.array(dtype=wp.uint8),
    tally_out: wp.array2d(dtype=wp.int64),
):
    """Write the samples and rays of PIXELS_OF_TALLY pixels, and the least and the most samples in one of them.

    Where `counted` has entries, only those pixels count that are not 0 there.
    """
    thread = first_thread + wp.tid()
    first = thread * wp.static(PIXELS_OF_TALLY)
    chosen = counted.shape[0] > 0
    samples = wp.int64(0)
    rays = wp.int64(0)
    least = int(0x7FFFFFFF)
    most = int(-1)
    for pixel in range(first, first + wp.min(wp.static(PIXELS_OF_TALLY), pixels - first)):
        counts = bool(True)
        if chosen:
            counts = counted[pixel] != wp.uint8(0)
        if counts:
            count = film.count[pixel]
            samples += wp.int64(count)
            rays += film.rays[pixel]
            least = wp.min(least, count)
            most = wp.max(most, count)
    tally_out[thread, 0] = samples
    tally_out[thread, 1] = rays
    tally_out[thread, 2] = wp.int64(least)
    tally_out[thread, 3] = wp.int64(most)


@wp.kernel(enable_backward=False)
def hide_pixels(
    first_pixel: int,
    hidden: wp.array(dtype=wp.uint8),
    samples: int,
    film: FilmData,
    count_before_out: wp.array(dtype=wp.int32),
):
    """Set the count of pixels that are not 0 in `hidden` to `samples`, so the pass skips them."""
    pixel = first_pixel + wp.tid()
    if hidden[pixel] != wp.uint8(0):
        count_before_out[pixel] = film.count[pixel]
        film.count[pixel] = samples


@wp.kernel(enable_backward=False)
def show_pixels(
    first_pixel: int, hidden: wp.array(dtype=wp.uint8), count_before: wp.array(dtype=wp.int32), film: FilmData
):
    """Undo `hide_pixels`."""
    pixel = first_pixel + wp.tid()
    if hidden[pixel] != wp.uint8(0):
        film.count[pixel] = count_before[pixel]
