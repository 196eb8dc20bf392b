"""Photons on a grid, and the light that they bring to a point.

The density of photons is estimated with the kernel of Epanechnikov (Silverman 1986, eq. 4.5), on the disk that the
surface cuts from a sphere: photon mapping after Jensen (1996). Each photon has a radius of its own, by the square root
of the density that a few of its neighbours show (Abramson 1982): a focus stays sharp, and dim light is smooth.
"""

from typing import Any

import warp as wp

from wrt.kernels.bsdf import make_bsdf, make_is_matt, models_with
from wrt.kernels.core.bsdf import Bsdf
from wrt.kernels.core.features import Features
from wrt.kernels.core.photon_map import Photon, PhotonMap
from wrt.kernels.core.rays import to_local
from wrt.kernels.core.scene_data import SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.integrators.light_groups import GroupSums, add_to_group
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

_COUNTED = wp.constant(24)
"""Photons of a bucket by which its crowding is measured."""

_LEAST_SPREAD = wp.constant(1.0 / 16.0)
"""Least r² of a photon over the map's: half a pixel at first. Most samples of a pixel would miss smaller dots."""


@wp.struct
class Caustic:
    """The radiance of photons that a surface scatters to a path."""

    radiance: wp.vec3


@wp.struct
class GroupedCaustic:
    """A Caustic, with the radiance by groups of lights."""

    radiance: wp.vec3
    groups: GroupSums


def caustic_type(light_groups: bool) -> Any:
    """Return the type of what photons bring for Features.light_groups."""
    return GroupedCaustic if light_groups else Caustic


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
    places_out: wp.array(dtype=wp.vec4),
    starts_out: wp.array(dtype=int),
    unsorted_out: wp.array(dtype=int),
):
    """Put photons in the order of keys, and write where buckets start; one more thread than keys.

    `unsorted_out` tells of keys that do not ascend: without memory a GPU does not sort.
    """
    i = first + wp.tid()
    if i > 0 and i < keys.shape[0]:
        if keys[i - 1] > keys[i]:
            unsorted_out[0] = 1
    buckets = starts_out.shape[0] - 1
    bucket = _bucket_at(keys, i, buckets)
    if bucket < buckets:
        photon = photons[int(keys[i] & _PHOTON_BITS)]
        photons_out[i] = photon
        places_out[i] = wp.vec4(photon.position[0], photon.position[1], photon.position[2], 0.0)
    for each in range(_bucket_at(keys, i - 1, buckets) + 1, bucket + 1):
        starts_out[each] = i


@wp.func
def corner_cell(position: wp.vec3, radius: float, corner: int) -> wp.vec3i:
    """Return one of the eight cells that the sphere around a position touches."""
    low = cell_of(position - wp.vec3(radius), radius)
    return low + wp.vec3i(corner & 1, (corner >> 1) & 1, corner >> 2)


@wp.kernel(enable_backward=False)
def spread_photons(first: int, photon_map: PhotonMap, places_out: wp.array(dtype=wp.vec4)):
    """Choose over which radius each photon is spread, in `places_out[i][3]`; at most the map's."""
    i = first + wp.tid()
    buckets = photon_map.starts.shape[0] - 1
    if i >= photon_map.starts[buckets]:
        return
    photon = photon_map.photons[i]
    radius = photon_map.radius
    found = float(0.0)
    for corner in range(8):
        cell = corner_cell(photon.position, radius, corner)
        bucket = bucket_of(cell, buckets)
        start = photon_map.starts[bucket]
        end = photon_map.starts[bucket + 1]
        # A few of a crowd tell its density.
        step = 1 + (end - start) // _COUNTED
        j = start
        while j < end:
            other = photon_map.photons[j]
            offset = other.position - photon.position
            share = 1.0 - wp.dot(offset, offset) / (radius * radius)
            if share > 0.0 and wp.abs(wp.dot(other.normal, photon.normal)) > _SAME_SURFACE:
                if cell_of(other.position, radius) == cell:
                    found += 2.0 * share * float(step)
            j += step
    place = places_out[i]
    place[3] = radius * radius * wp.clamp(photon_map.crowd / wp.max(found, 1.0), _LEAST_SPREAD, 1.0)
    places_out[i] = place


@specialised("models", "tangents", "light_groups")
def make_gather(features: Features) -> wp.Function:
    """Return the device function (scene, map, bsdf, wo, surface, most_turns) -> Caustic or GroupedCaustic towards wo.

    Photons that surfaces have turned more often than `most_turns` are left out. Photons that rough surfaces have
    scattered before are for matt surfaces alone.
    """
    is_matt = make_is_matt(features.models)
    evaluate = make_bsdf(features.models).evaluate
    transmits = bool(models_with(features.models, "transmits"))
    Result = caustic_type(features.light_groups)

    @wp.func
    def gather(
        scene: SceneData, photon_map: PhotonMap, bsdf: Bsdf, wo: wp.vec3, surface: Surface, most_turns: int
    ) -> Result:
        result = Result()
        radius = photon_map.radius
        buckets = photon_map.starts.shape[0] - 1
        matt = is_matt(bsdf)
        corner = int(0)
        while corner < 8:
            cell = corner_cell(surface.position, radius, corner)
            bucket = bucket_of(cell, buckets)
            i = photon_map.starts[bucket]
            end = photon_map.starts[bucket + 1]
            while i < end:
                place = photon_map.places[i]
                position = wp.vec3(place[0], place[1], place[2])
                offset = position - surface.position
                share = 1.0 - wp.dot(offset, offset) / place[3]
                if share > 0.0:
                    photon = photon_map.photons[i]
                    alike = wp.abs(wp.dot(photon.normal, surface.normal)) > _SAME_SURFACE
                    # Cells that share a bucket must not count its photons twice.
                    if (
                        alike
                        and photon.turns <= most_turns
                        and (matt or not photon.was_scattered)
                        and cell_of(position, radius) == cell
                    ):
                        wi = to_local(surface.frame, photon.towards)
                        # Power per area is radiance times the geometric cosine, not that of `evaluate`.
                        cosine = wp.dot(photon.towards, surface.normal)
                        above = cosine > 0.0
                        if above == (wi[2] > 0.0) and (above or wp.static(transmits)):
                            value = evaluate(bsdf, wo, wi)
                            if wp.static(features.tangents):
                                value = value * bump_shadow(surface, photon.towards, wi[2])
                            density = share / (place[3] * wp.max(wp.abs(cosine), _LEAST_COSINE))
                            radiance = wp.cw_mul(value, photon.power) * density
                            result.radiance += radiance
                            if wp.static(features.light_groups):
                                result.groups = add_to_group(scene, result.groups, photon.light, radiance)
                i += 1
            corner += 1
        result.radiance = result.radiance * (2.0 / PI)
        if wp.static(features.light_groups):
            result.groups = result.groups * (2.0 / PI)
        return result

    return gather
