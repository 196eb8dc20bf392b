"""The photons of one set as the path tracer reads them."""

import warp as wp


@wp.struct
class Photon:
    """Light that smooth surfaces have thrown onto one that scatters.

    `towards` is the unit vector to where it came from, `normal` the geometric normal on that side. `power` is in watts;
    `turns` counts the surfaces that have turned it. It `was_scattered` if one of them is not smooth. `light` is the
    number of its light, that of lights for a constant environment; kept for light groups only.
    """

    position: wp.vec3
    towards: wp.vec3
    normal: wp.vec3
    power: wp.vec3
    turns: int
    was_scattered: bool
    light: int


@wp.struct
class PhotonMap:
    """The photons of a set by buckets: those of bucket b are `starts[b]` to `starts[b + 1]` − 1 of `photons`.

    Cells of a grid, twice `radius` wide, are hashed into buckets; the number of buckets is a power of two. `places` has
    the position of each photon and the square of the radius over which it is spread, at most `radius`. That radius is
    chosen so that a photon covers `crowd` others on average.
    """

    photons: wp.array(dtype=Photon)
    places: wp.array(dtype=wp.vec4)
    starts: wp.array(dtype=int)
    radius: float
    crowd: float
