"""Photons on a grid, and the light that they bring to a point.

The density of photons is estimated with the kernel of Epanechnikov (Silverman 1986, eq. 4.5), on the disk that the
surface cuts from a sphere: photon mapping after Jensen (1996).
"""

import warp as wp

from wrt.kernels.bsdf import make_bsdf, models_with
from wrt.kernels.core.features import Features
from wrt.kernels.core.photon_map import Photon, PhotonMap
from wrt.kernels.core.rays import to_local
from wrt.kernels.core.specialise import specialised
from wrt.kernels.integrators.path_state import SurfaceVertex
from wrt.kernels.sampling.sampler import hash_4d
from wrt.kernels.sampling.warps import PI
from wrt.kernels.textures.normal_maps import bump_shadow

NO_PHOTON = wp.constant(wp.int64(2**62))
"""The key of a photon that was lost, greater than all others."""

_PHOTON_BITS = wp.constant(wp.int64(2**32 - 1))
_FARTHEST_CELL = wp.constant(1.0e9)

_SAME_SURFACE = wp.constant(0.8)
"""Least cosine between the normals of a photon and of the point that gathers it: other walls of a corner stay out."""

_LEAST_COSINE = wp.constant(1.0e-5)


@wp.func
def cell_of(position: wp.vec3, radius: float) -> wp.vec3i:
    """Return the cell of a position, in a grid for photons that are gathered within a radius."""
    scaled = position / (2.0 * radius)
    x = wp.clamp(wp.floor(scaled[0]), -_FARTHEST_CELL, _FARTHEST_CELL)
    y = wp.clamp(wp.floor(scaled[1]), -_FARTHEST_CELL, _FARTHEST_CELL)
    z = wp.clamp(wp.floor(scaled[2]), -_FARTHEST_CELL, _FARTHEST_CELL)
    return wp.vec3i(int(x), int(y), int(z))


@wp.func
def bucket_of(cell: wp.vec3i, buckets: int) -> int:
    """Return the bucket of a cell; the number of buckets is a power of two."""
    hashed = hash_4d(wp.uint32(cell[0]), wp.uint32(cell[1]), wp.uint32(cell[2]), wp.uint32(0))
    return int(hashed[0] & wp.uint32(buckets - 1))


@wp.func
def key_of(photon_map: PhotonMap, position: wp.vec3, photon: int) -> wp.int64:
    """Return the key by which photons are sorted: no two are equal, so their order depends on nothing else."""
    bucket = bucket_of(cell_of(position, photon_map.radius), photon_map.starts.shape[0] - 1)
    return (wp.int64(bucket) << wp.int64(32)) | wp.int64(photon)


@wp.func
def _bucket_at(keys: wp.array(dtype=wp.int64), i: int, buckets: int) -> int:
    """Return the bucket of the i-th sorted key: −1 before the first, `buckets` after the last photon."""
    if i < 0:
        return -1
    if i >= keys.shape[0] or keys[i] == NO_PHOTON:
        return buckets
    return int(keys[i] >> wp.int64(32))


@wp.kernel(enable_backward=False)
def arrange_photons(
    first: int,
    keys: wp.array(dtype=wp.int64),
    photons: wp.array(dtype=Photon),
    photons_out: wp.array(dtype=Photon),
    starts_out: wp.array(dtype=int),
):
    """Put photons in the order of sorted keys, and write where buckets start; one more thread than keys."""
    i = first + wp.tid()
    buckets = starts_out.shape[0] - 1
    bucket = _bucket_at(keys, i, buckets)
    if bucket < buckets:
        photons_out[i] = photons[int(keys[i] & _PHOTON_BITS)]
    for each in range(_bucket_at(keys, i - 1, buckets) + 1, bucket + 1):
        starts_out[each] = i


@specialised("models", "tangents")
def make_gather(features: Features) -> wp.Function:
    """Return the device function (photon map, vertex, most_turns) -> radiance of photons that it scatters to the path.

    Photons that smooth surfaces have turned more often than `most_turns` are left out.
    """
    evaluate = make_bsdf(features.models).evaluate
    transmits = bool(models_with(features.models, "transmits"))

    @wp.func
    def gather(photon_map: PhotonMap, vertex: SurfaceVertex, most_turns: int) -> wp.vec3:
        total = wp.vec3()
        radius = photon_map.radius
        buckets = photon_map.starts.shape[0] - 1
        position = vertex.surface.position
        low = cell_of(position - wp.vec3(radius), radius)
        corner = int(0)
        while corner < 8:
            cell = low + wp.vec3i(corner & 1, (corner >> 1) & 1, corner >> 2)
            bucket = bucket_of(cell, buckets)
            for i in range(photon_map.starts[bucket], photon_map.starts[bucket + 1]):
                photon = photon_map.photons[i]
                offset = photon.position - position
                share = 1.0 - wp.dot(offset, offset) / (radius * radius)
                alike = wp.abs(wp.dot(photon.normal, vertex.surface.normal)) > _SAME_SURFACE
                # Cells that share a bucket must not count its photons twice.
                if share > 0.0 and alike and photon.turns <= most_turns and cell_of(photon.position, radius) == cell:
                    wi = to_local(vertex.surface.frame, photon.towards)
                    # Power per area is radiance times the geometric cosine, not that of `evaluate`.
                    cosine = wp.dot(photon.towards, vertex.surface.normal)
                    above = cosine > 0.0
                    if above == (wi[2] > 0.0) and (above or wp.static(transmits)):
                        value = evaluate(vertex.bsdf, vertex.wo, wi)
                        if wp.static(features.tangents):
                            value = value * bump_shadow(vertex.surface, photon.towards, wi[2])
                        total += wp.cw_mul(value, photon.power) * (share / wp.max(wp.abs(cosine), _LEAST_COSINE))
            corner += 1
        return total * (2.0 / (PI * radius * radius))

    return gather
