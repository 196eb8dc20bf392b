"""The BSDF of a material at a point."""

import warp as wp

from wrt.kernels.bsdf import make_by_viewer, model_of, models_with
from wrt.kernels.bsdf.lobes.dispersion import shares_of
from wrt.kernels.core.bsdf import Bsdf, slot_values
from wrt.kernels.core.features import Features
from wrt.kernels.core.registry import model_number
from wrt.kernels.core.scene_data import MaterialRecord, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.geometry.surface import Surface
from wrt.kernels.materials.choice import leaves_of, make_next_leaf
from wrt.kernels.textures.textures import VALUES, make_slot_value

MOST_LINKS = 3
"""The most models of a scene for which each has its own code to load its values."""


@specialised()
def make_with_indices(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf, index, indices) -> Bsdf with its refractive index, inside over outside.

    Models with dispersion take `indices`, one for each channel, the others `index`. Some models need the lower index in
    front: if `index` < 1, front and back are swapped and the indices inverted, for all channels alike.
    """
    if not names:
        return _same_bsdf_of_channels
    model, number, next_with_indices = model_of(names[0]), model_number(names[0]), make_with_indices(names[1:])
    if model.index_slot < 0:
        return next_with_indices

    @wp.func
    def chain(bsdf: Bsdf, index: float, indices: wp.vec3) -> Bsdf:
        if bsdf.model == wp.static(number):
            swapped = index < 1.0
            if swapped:
                bsdf.front = not bsdf.front
            if wp.static(model.channels_slot >= 0):
                inverse = wp.vec3(1.0 / indices[0], 1.0 / indices[1], 1.0 / indices[2])
                bsdf.slots[wp.static(model.index_slot)] = wp.where(swapped, inverse, indices)
            else:
                bsdf.slots[wp.static(model.index_slot)] = wp.vec3(wp.where(swapped, 1.0 / index, index))
            return bsdf
        return next_with_indices(bsdf, index, indices)

    return chain


@specialised()
def make_with_throughput(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf, throughput) -> Bsdf, whose channels are chosen by a path's throughput."""
    if not names:
        return _same_bsdf_of_path
    number, slot = model_number(names[0]), model_of(names[0]).channels_slot
    next_with_throughput = make_with_throughput(names[1:])
    if slot < 0:
        return next_with_throughput

    @wp.func
    def chain(bsdf: Bsdf, throughput: wp.vec3) -> Bsdf:
        if bsdf.model == wp.static(number):
            bsdf.slots[wp.static(slot)] = shares_of(throughput)
            return bsdf
        return next_with_throughput(bsdf, throughput)

    return chain


@specialised()
def make_with_normals(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf, normals) -> Bsdf with what `normals_of_layers` returns, if it uses that."""
    if not names:
        return _same_bsdf_of_normals
    number, slot, next_with_normals = model_number(names[0]), model_of(names[0]).coat_slot, make_with_normals(names[1:])
    if slot < 0:
        return next_with_normals

    @wp.func
    def chain(bsdf: Bsdf, normals: wp.vec4) -> Bsdf:
        if bsdf.model == wp.static(number):
            bsdf.slots[wp.static(slot)] = wp.vec3(bsdf.slots[wp.static(slot)][0], normals[0], normals[1])
            bsdf.slots[wp.static(slot + 1)] = wp.vec3(bsdf.slots[wp.static(slot + 1)][0], normals[2], normals[3])
            return bsdf
        return next_with_normals(bsdf, normals)

    return chain


@specialised()
def make_at(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (bsdf, surface) -> Bsdf: `Model.at` of its model, if that has one."""
    if not names:
        return _same_bsdf_at
    function, number, next_at = model_of(names[0]).at, model_number(names[0]), make_at(names[1:])
    if function is None:
        return next_at

    @wp.func
    def chain(bsdf: Bsdf, surface: Surface) -> Bsdf:
        if bsdf.model == wp.static(number):
            return function(bsdf, surface)
        return next_at(bsdf, surface)

    return chain


@wp.func
def _nothing_straight(bsdf: Bsdf, wo: wp.vec3) -> wp.vec3:
    return wp.vec3(0.0)


@wp.func
def _same_bsdf_of_channels(bsdf: Bsdf, index: float, indices: wp.vec3) -> Bsdf:
    return bsdf


@wp.func
def _same_bsdf_of_path(bsdf: Bsdf, throughput: wp.vec3) -> Bsdf:
    return bsdf


@wp.func
def _same_bsdf_at(bsdf: Bsdf, surface: Surface) -> Bsdf:
    return bsdf


@wp.func
def _same_bsdf_of_normals(bsdf: Bsdf, normals: wp.vec4) -> Bsdf:
    return bsdf


def have_coat_normals(names: tuple[str, ...]) -> bool:
    """Return whether any of these models has a coat with normals of its own."""
    return any(model_of(name).coat_slot >= 0 for name in names)


def disperses(names: tuple[str, ...]) -> bool:
    """Return whether any of these models refracts each channel by an index of its own."""
    return any(model_of(name).channels_slot >= 0 for name in names)


@specialised("models", "gpu", *VALUES)
def make_share_passed(features: Features, *, holes_only: bool = False) -> wp.Function:
    """Return the device function (scene, material, surface, wo) -> vec3: the share of light that goes straight through.

    It is the mean over `choose_material` of holes and, unless `holes_only`, of panes. Light leaves along `wo`, in the
    surface's frame.
    """
    panes = bool(models_with(features.models, "straight")) and not holes_only
    bsdf_at, straight = make_bsdf_at(features), make_by_viewer(features.models, "straight", _nothing_straight)
    next_leaf = make_next_leaf(features.uv2_alpha, False, features.procedures)  # shadow rays carry no footprint

    @wp.func
    def share_passed(scene: SceneData, material: int, surface: Surface, wo: wp.vec3) -> wp.vec3:
        leaves = leaves_of(material)
        through = wp.vec3(0.0)
        while leaves.remaining > 0:
            leaves = next_leaf(scene, leaves, surface)
            if wp.static(panes):
                if leaves.share > 0.0:
                    through += straight(bsdf_at(scene, leaves.leaf, surface), wo) * leaves.share
        return through + wp.vec3(leaves.passed)

    return share_passed


@specialised("models", "gpu", *VALUES)
def make_bsdf_at(features: Features) -> wp.Function:
    """Return the device function (scene, material, surface) -> Bsdf for the models of `features`."""
    slot_value = _constant_value
    if features.textured:
        slot_value = make_slot_value(features.uv2_alpha, features.mipmapped, features.procedures)
    if len(features.models) > (0 if features.gpu else MOST_LINKS):
        return _make_load_at_once(features.models, slot_value, in_loop=features.gpu)
    return _make_load(features.models, slot_value)


@wp.func
def _constant_value(scene: SceneData, slot: int, surface: Surface) -> wp.vec3:
    return scene.slots[slot].value


@specialised()
def _make_load(names: tuple[str, ...], slot_value: wp.Function) -> wp.Function:
    """Return a chain of one link per model, as in `kernels.bsdf.make_bsdf`: each loads the values of its model."""
    if not names:
        return _no_bsdf
    number, count = model_number(names[0]), model_of(names[0]).slots
    next_load, at = _make_load(names[1:], slot_value), make_at(names[:1])
    varies = model_of(names[0]).at is not None

    @wp.func
    def load(scene: SceneData, material: int, surface: Surface) -> Bsdf:
        record = scene.materials[material]
        if record.model == wp.static(number):
            values = slot_values()
            for k in range(wp.static(count)):
                values[k] = slot_value(scene, record.first_slot + k, surface)
            bsdf = _without_values(scene, record, surface)
            bsdf.slots = values
            if wp.static(varies):
                bsdf = at(bsdf, surface)
            return bsdf
        return next_load(scene, material, surface)

    return load


@specialised()
def _make_load_at_once(names: tuple[str, ...], slot_value: wp.Function, *, in_loop: bool) -> wp.Function:
    """Return one piece of code for all models, which loads as many values as the model has.

    In a wide kernel each link of a chain copies 2.7 KB of values for sixteen lanes. With `in_loop` a texture is looked
    up in one place, and values stay in memory, not in registers: on CUDA the kernel of eight textured models is a third
    shorter so, and spills a half (docs/notes/cuda.md).
    """
    slot_count, most = make_slot_count(names), max(model_of(name).slots for name in names)
    at, vary = make_at(names), bool(models_with(names, "at"))

    @wp.func
    def load(scene: SceneData, material: int, surface: Surface) -> Bsdf:
        record = scene.materials[material]
        count = slot_count(record.model)
        bsdf = _without_values(scene, record, surface)
        if wp.static(in_loop):
            for k in range(count):
                bsdf.slots[k] = slot_value(scene, record.first_slot + k, surface)
        else:
            for k in range(wp.static(most)):
                if k < count:
                    bsdf.slots[k] = slot_value(scene, record.first_slot + k, surface)
        if wp.static(vary):
            return at(bsdf, surface)
        return bsdf

    return load


@specialised()
def make_slot_count(names: tuple[str, ...]) -> wp.Function:
    """Return the device function (model) -> the number of values that it reads."""
    if not names:
        return _no_slots
    number, count = model_number(names[0]), model_of(names[0]).slots
    next_count = make_slot_count(names[1:])

    @wp.func
    def slot_count(model: int) -> int:
        if model == wp.static(number):
            return wp.static(count)
        return next_count(model)

    return slot_count


@wp.func
def _without_values(scene: SceneData, record: MaterialRecord, surface: Surface) -> Bsdf:
    """Return a material at a point, all but its values."""
    bsdf = Bsdf()
    bsdf.model = record.model
    bsdf.front = surface.front
    bsdf.tables = scene.tables
    bsdf.table = record.table
    bsdf.normal_variance = surface.normal_variance
    return bsdf


@wp.func
def _no_slots(model: int) -> int:
    return 0


@wp.func
def _no_bsdf(scene: SceneData, material: int, surface: Surface) -> Bsdf:
    bsdf = Bsdf()
    bsdf.model = -1
    return bsdf
