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


@wp.struct
class FilmReading:
    """How a film is read, see `wrt/rendering/reading.py`.

    The film is `width` pixels wide. The picture is `picture_width` wide and begins at the column `left` and the row
    `top` of the film. `share` of a pixel's mean goes to each neighbour.
    """

    width: int
    picture_width: int
    left: int
    top: int
    share: wp.float64


@wp.func
def _kept_share(share: wp.float64, place: int, length: int) -> wp.float64:
    """Return the share of its mean that a pixel keeps in a row or column of `length` pixels."""
    kept_share = wp.float64(1.0)
    if place > 0:
        kept_share -= share
    if place < length - 1:
        kept_share -= share
    return kept_share


@wp.func
def _mean(total: wp.array(dtype=wp.vec3d), count: wp.array(dtype=wp.int32), pixel: int) -> wp.vec3d:
    return total[pixel] / wp.float64(wp.max(count[pixel], 1))


@wp.func
def _mean_down(
    total: wp.array(dtype=wp.vec3d), count: wp.array(dtype=wp.int32), reading: FilmReading, x: int, y: int
) -> wp.vec3d:
    """Return the mean of a pixel, blended with those of the pixels above and below it."""
    pixel = y * reading.width + x
    mean = _mean(total, count, pixel)
    if reading.share == wp.float64(0.0):
        return mean
    height = count.shape[0] // reading.width
    neighbours = wp.vec3d()
    if y > 0:
        neighbours += _mean(total, count, pixel - reading.width)
    if y < height - 1:
        neighbours += _mean(total, count, pixel + reading.width)
    return neighbours * reading.share + _kept_share(reading.share, y, height) * mean


@wp.func
def _variance(film: FilmData, pixel: int) -> wp.vec3d:
    """Return the variance of a pixel's mean; 0 below two samples."""
    n = wp.float64(film.count[pixel])
    variance = wp.vec3d()
    if n > wp.float64(1.0):
        mean = film.total[pixel] / n
        spread = film.total_of_squares[pixel] / n - wp.cw_mul(mean, mean)
        variance = wp.max(spread, wp.vec3d()) / (n - wp.float64(1.0))
    return variance


@wp.func
def _variance_down(film: FilmData, reading: FilmReading, x: int, y: int) -> wp.vec3d:
    """Return the variance of what `_mean_down` returns."""
    pixel = y * reading.width + x
    variance = _variance(film, pixel)
    if reading.share == wp.float64(0.0):
        return variance
    height = film.count.shape[0] // reading.width
    neighbours = wp.vec3d()
    if y > 0:
        neighbours += _variance(film, pixel - reading.width)
    if y < height - 1:
        neighbours += _variance(film, pixel + reading.width)
    kept_share = _kept_share(reading.share, y, height)
    return neighbours * (reading.share * reading.share) + (kept_share * kept_share) * variance


@wp.kernel(enable_backward=False)
def film_noise(
    first_row: int,
    reading: FilmReading,
    film: FilmData,
    mean_out: wp.array(dtype=wp.float64),
    error_out: wp.array(dtype=wp.float64),
):
    """Sum the pixels' means, and the standard errors of these as they are read, over each row and all channels."""
    row = first_row + wp.tid()
    mean = wp.float64(0.0)
    error = wp.float64(0.0)
    previous = wp.vec3d()
    current = _variance_down(film, reading, 0, row)
    for x in range(reading.width):
        pixel = row * reading.width + x
        n = wp.float64(film.count[pixel])
        following = wp.vec3d()
        if x < reading.width - 1:
            following = _variance_down(film, reading, x + 1, row)
        kept_share = _kept_share(reading.share, x, reading.width)
        variance = (previous + following) * (reading.share * reading.share) + (kept_share * kept_share) * current
        if n > wp.float64(1.0):
            total = film.total[pixel]
            for c in range(3):
                mean += total[c] / n
                error += wp.sqrt(variance[c])
        previous = current
        current = following
    mean_out[row] = mean
    error_out[row] = error


@wp.kernel(enable_backward=False)
def film_mean(
    first_thread: int,
    total: wp.array(dtype=wp.vec3d),
    count: wp.array(dtype=wp.int32),
    reading: FilmReading,
    mean_out: wp.array(dtype=wp.vec3),
):
    """Write the picture, of means of each pixel's samples; black where there are none."""
    place = first_thread + wp.tid()
    x = reading.left + place % reading.picture_width
    y = reading.top + place // reading.picture_width
    mean = _mean_down(total, count, reading, x, y)
    if reading.share > wp.float64(0.0):
        neighbours = wp.vec3d()
        if x > 0:
            neighbours += _mean_down(total, count, reading, x - 1, y)
        if x < reading.width - 1:
            neighbours += _mean_down(total, count, reading, x + 1, y)
        mean = neighbours * reading.share + _kept_share(reading.share, x, reading.width) * mean
    mean_out[place] = wp.vec3(float(mean[0]), float(mean[1]), float(mean[2]))


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
