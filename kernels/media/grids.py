"""Media whose density varies on a grid: tentative collisions, and tracking along a ray.

Tentative collisions fall as in a medium of the majorant's density. At each the real density decides whether the light
meets something (delta tracking: Woodcock and others 1965), or how much weight it keeps (ratio tracking: Novák, Selle
and Jarosz, "Residual ratio tracking for estimating attenuation in participating media", 2014). Majorant and minorant
are constant within each cell of a coarse grid, through which a ray goes cell by cell. Where no light is scattered or
emitted, what the minorant lets pass is known in closed form, and collisions are with the rest alone (residual ratio
tracking, in the same paper): where the density is even, there is no noise.

Channels share the collisions. Those of a path are real with the mean probability of the channels, by what the path
carries of each, which is the balance heuristic over the channels (Kutz, Habel, Li and Novák, "Spectral and
decomposition tracking for rendering heterogeneous volumes", 2017, section 5.1.2; Miller, Georgiev and Jarosz, "A
null-scattering path integral formulation of light transport", 2019). As in homogeneous media, the sum of what a path
carries never grows.
"""

import warp as wp

from wrt.kernels.core.elementary import logarithm
from wrt.kernels.core.features import Features
from wrt.kernels.core.rays import Ray
from wrt.kernels.core.scene_data import BodyStack, GridRecord, Lattice, MediumRecord, SceneData
from wrt.kernels.core.specialise import specialised
from wrt.kernels.media.medium import make_extinction, medium_of, transmittance
from wrt.kernels.sampling.sampler import stream_4d, stream_key

_FAINT = wp.constant(0.1)
"""Russian roulette begins where ratio tracking has left less than this share of the light."""

_LEAST = wp.constant(1.0e-37)
"""Instead of 0 in a denominator."""


@wp.func
def is_in_grid(scene: SceneData, medium: int) -> bool:
    """Return whether there is a medium whose density varies."""
    return medium >= 0 and scene.media[wp.max(medium, 0)].grid >= 0


@wp.struct
class Corners:
    """The eight cells of a lattice whose centres surround a point: indices along the axes, and weights of the second.

    At the faces of the box both cells of an axis are the outermost one.
    """

    x0: int
    x1: int
    y0: int  # of a row: the index of its first cell
    y1: int
    z0: int
    z1: int
    weight: wp.vec3


@wp.func
def corners_at(lattice: Lattice, place: wp.vec3) -> Corners:
    """Return the cells around a place in the unit cube."""
    corners = Corners()
    x = wp.clamp(place[0] * float(lattice.nx) - 0.5, 0.0, float(lattice.nx - 1))
    y = wp.clamp(place[1] * float(lattice.ny) - 0.5, 0.0, float(lattice.ny - 1))
    z = wp.clamp(place[2] * float(lattice.nz) - 0.5, 0.0, float(lattice.nz - 1))
    i, j, k = int(x), int(y), int(z)
    corners.weight = wp.vec3(x - float(i), y - float(j), z - float(k))
    corners.x0 = i
    corners.x1 = wp.min(i + 1, lattice.nx - 1)
    corners.y0 = j * lattice.nx
    corners.y1 = wp.min(j + 1, lattice.ny - 1) * lattice.nx
    layer = lattice.nx * lattice.ny
    corners.z0 = lattice.first + k * layer
    corners.z1 = lattice.first + wp.min(k + 1, lattice.nz - 1) * layer
    return corners


@specialised()
def make_value_at(dtype: type) -> wp.Function:
    """Return the device function (values, lattice, place) -> the value, of a number or a colour for each cell.

    It is trilinear between the centres of cells; the place is in the unit cube.
    """

    @wp.func
    def value_at(values: wp.array(dtype=dtype), lattice: Lattice, place: wp.vec3) -> dtype:
        c = corners_at(lattice, place)
        wx, wy, wz = c.weight[0], c.weight[1], c.weight[2]
        a = wp.lerp(values[c.z0 + c.y0 + c.x0], values[c.z0 + c.y0 + c.x1], wx)
        b = wp.lerp(values[c.z0 + c.y1 + c.x0], values[c.z0 + c.y1 + c.x1], wx)
        d = wp.lerp(values[c.z1 + c.y0 + c.x0], values[c.z1 + c.y0 + c.x1], wx)
        e = wp.lerp(values[c.z1 + c.y1 + c.x0], values[c.z1 + c.y1 + c.x1], wx)
        return wp.lerp(wp.lerp(a, b, wy), wp.lerp(d, e, wy), wz)

    return value_at


number_at = make_value_at(float)
color_at = make_value_at(wp.vec3)


@wp.struct
class Walk:
    """A ray's walk through the cells of the majorants, from collision to collision.

    `origin` and `direction` are those of the ray in units of cells, so that distances stay those along the ray. The
    walk is at `t` and ends at `t_end`, or behind the last cell. The optical depth to the next tentative collision is
    `depth_left`. If not `is_collision`, the walk has entered a cell, or is done. `rate` is the coefficient of
    collisions in the last cell, with density above `control`. `passed` is the integral of the control so far; it is 0
    unless `is_residual`.
    """

    origin: wp.vec3
    direction: wp.vec3
    x: int
    y: int
    z: int
    t: float
    t_end: float
    depth_left: float
    rate: float
    control: float
    passed: float
    is_residual: bool
    is_collision: bool


@wp.func
def in_unit_cube(grid: GridRecord, v: wp.vec3, w: float) -> wp.vec3:
    """Return a point (w = 1) or a direction (w = 0) of the world in the unit cube; directions change their length."""
    p = wp.vec4(v[0], v[1], v[2], w)
    return wp.vec3(wp.dot(grid.to_unit_x, p), wp.dot(grid.to_unit_y, p), wp.dot(grid.to_unit_z, p))


@wp.func
def optical_depth_to_collision(u: float) -> float:
    """Return the optical depth up to the next tentative collision."""
    return -logarithm(1.0 - u)


@wp.func
def begin_walk(grid: GridRecord, ray: Ray, reach: float, u: float) -> Walk:
    """Return a walk along a ray for a distance `reach`, as far as that is within the grid's box."""
    cells = grid.majorants
    counts = wp.vec3(float(cells.nx), float(cells.ny), float(cells.nz))
    walk = Walk()
    walk.origin = wp.cw_mul(in_unit_cube(grid, ray.origin, 1.0), counts)
    walk.direction = wp.cw_mul(in_unit_cube(grid, ray.direction, 0.0), counts)
    walk.t_end = reach
    for axis in range(3):
        o, d = walk.origin[axis], walk.direction[axis]
        if d != 0.0:
            walk.t = wp.max(walk.t, wp.min(-o / d, (counts[axis] - o) / d))
            walk.t_end = wp.min(walk.t_end, wp.max(-o / d, (counts[axis] - o) / d))
        elif o < 0.0 or o > counts[axis]:
            walk.t_end = 0.0
    place = walk.origin + walk.direction * walk.t
    walk.x = int(wp.clamp(place[0], 0.0, counts[0] - 1.0))
    walk.y = int(wp.clamp(place[1], 0.0, counts[1] - 1.0))
    walk.z = int(wp.clamp(place[2], 0.0, counts[2] - 1.0))
    walk.depth_left = optical_depth_to_collision(u)
    return walk


@wp.func
def distance_to_face(origin: float, direction: float, cell: int) -> float:
    """Return the distance at which a ray leaves a cell along one axis."""
    if direction > 0.0:
        return (float(cell + 1) - origin) / direction
    if direction < 0.0:
        return (float(cell) - origin) / direction
    return wp.inf


@wp.func
def step(values: wp.array(dtype=float), grid: GridRecord, tracking: float, before: Walk) -> Walk:
    """Return the walk at the next tentative collision, or in the next cell if that comes first."""
    walk = before
    cells = grid.majorants
    cell = (walk.z * cells.ny + walk.y) * cells.nx + walk.x
    if walk.is_residual:
        walk.control = values[grid.minorants.first + cell]
    walk.rate = tracking * (values[cells.first + cell] - walk.control)
    exit_x = distance_to_face(walk.origin[0], walk.direction[0], walk.x)
    exit_y = distance_to_face(walk.origin[1], walk.direction[1], walk.y)
    exit_z = distance_to_face(walk.origin[2], walk.direction[2], walk.z)
    first = wp.min(exit_x, wp.min(exit_y, exit_z))
    # Rounding can put the face a little behind the walk.
    t_exit = wp.max(walk.t, wp.min(first, walk.t_end))
    depth = walk.rate * (t_exit - walk.t)
    walk.is_collision = walk.depth_left < depth
    if walk.is_collision:
        walk.t = wp.min(walk.t + walk.depth_left / walk.rate, t_exit)
        walk.passed = walk.passed + walk.control * (walk.t - before.t)
    else:
        walk.depth_left = walk.depth_left - depth
        walk.t = t_exit
        walk.passed = walk.passed + walk.control * (walk.t - before.t)
        if first >= walk.t_end:
            walk.t = walk.t_end
        elif exit_x == first:
            walk.x = walk.x + wp.where(walk.direction[0] > 0.0, 1, -1)
        elif exit_y == first:
            walk.y = walk.y + wp.where(walk.direction[1] > 0.0, 1, -1)
        else:
            walk.z = walk.z + wp.where(walk.direction[2] > 0.0, 1, -1)
        inside = walk.x >= 0 and walk.x < cells.nx and walk.y >= 0 and walk.y < cells.ny
        if not (inside and walk.z >= 0 and walk.z < cells.nz):
            walk.t = walk.t_end
    return walk


@wp.func
def is_done(walk: Walk) -> bool:
    """Return whether a walk has come to its end."""
    return not (walk.t < walk.t_end)


@wp.func
def place_of(grid: GridRecord, walk: Walk) -> wp.vec3:
    """Return where in the unit cube a walk is."""
    cells = grid.majorants
    counts = wp.vec3(float(cells.nx), float(cells.ny), float(cells.nz))
    return wp.cw_div(walk.origin + walk.direction * walk.t, counts)


@wp.struct
class GridFlight:
    """A flight through a medium on a grid: where it ends, and what is then left of the light.

    `radiance` is the medium's emission along it.
    """

    distance: float
    scattered: bool
    throughput: wp.vec3
    radiance: wp.vec3


@wp.func
def roulette_factor(throughput: float, faint: float, u: float) -> float:
    """Return the factor of Russian roulette, which raises a throughput below `faint` to it or ends it."""
    if throughput >= faint:
        return 1.0
    if u * faint < throughput:
        return faint / throughput
    return 0.0


@wp.func
def emission_at(scene: SceneData, medium: MediumRecord, grid: GridRecord, place: wp.vec3) -> wp.vec3:
    """Return the emission at a place of the grid if the density were 1."""
    if grid.emission.nx > 0:
        return wp.cw_mul(medium.emission, color_at(scene.grid_colors, grid.emission, place))
    return medium.emission


@wp.func
def scattering_at(scene: SceneData, medium: MediumRecord, grid: GridRecord, place: wp.vec3) -> wp.vec3:
    """Return the scattering coefficient at a place of the grid if the density were 1."""
    if grid.albedo.nx > 0:
        return wp.cw_mul(medium.absorption + medium.scattering, color_at(scene.grid_colors, grid.albedo, place))
    return medium.scattering


@specialised()
def make_fly_in_grid(media: str) -> wp.Function:
    """Return (scene, medium, ray, reach, throughput, u_first, key, is_shadow_ray) -> GridFlight of at most `reach`.

    In media that scatter it is by delta tracking. In others, and along shadow rays, it is by ratio tracking, where what
    is scattered counts as lost. `u_first` are the numbers of the first tentative collision, by which it is real and its
    distance; those of others come from the stream of `key`. If media only absorb by `Features`, scattering is left out.
    """

    @wp.func
    def fly_in_grid(
        scene: SceneData,
        medium: MediumRecord,
        ray: Ray,
        reach: float,
        throughput: wp.vec3,
        u_first: wp.vec2,
        key: wp.vec4ui,
        is_shadow_ray: bool,
    ) -> GridFlight:
        grid = scene.grids[medium.grid]
        scatters = bool(False)
        if wp.static(media == "scattering"):
            scatters = not is_shadow_ray and (wp.max(medium.scattering) > 0.0 or grid.albedo.nx > 0)
        shines = not is_shadow_ray and wp.max(medium.emission) > 0.0
        faint = _FAINT * wp.max(throughput)
        extinction = medium.absorption
        if wp.static(media == "scattering"):
            extinction += medium.scattering
        flight = GridFlight()
        flight.distance = reach
        flight.throughput = throughput
        walk = begin_walk(grid, ray, reach, u_first[1])
        walk.is_residual = not scatters and not shines
        if wp.static(media != "scattering"):
            walk.is_residual = walk.is_residual and grid.albedo.nx == 0
        u = u_first[0]
        collisions = int(0)
        while not is_done(walk):
            walk = step(scene.grid_values, grid, medium.tracking, walk)
            if walk.is_collision:
                place = place_of(grid, walk)
                density = number_at(scene.grid_values, grid.density, place)
                share = (density - walk.control) / walk.rate
                carried = flight.throughput
                if shines:
                    flight.radiance += wp.cw_mul(carried, emission_at(scene, medium, grid, place)) * share
                if wp.static(media != "scattering"):
                    if grid.albedo.nx > 0:
                        # What does not scatter is absorbed.
                        total = medium.absorption + medium.scattering
                        extinction = total - scattering_at(scene, medium, grid, place)
                # The share of tentative collisions that are real, per channel; rounding can take it beyond 0 or 1.
                real = wp.min(extinction * wp.max(share, 0.0), wp.vec3(1.0))
                chance = float(0.0)
                if scatters:
                    carried_sum = wp.max(carried[0] + carried[1] + carried[2], _LEAST)
                    chance = wp.min(wp.dot(carried, real) / carried_sum, 1.0)
                if u < chance:
                    scattered = scattering_at(scene, medium, grid, place) * share
                    flight.throughput = wp.cw_mul(carried, scattered) / chance
                    flight.distance = walk.t
                    flight.scattered = True
                    walk.t_end = walk.t
                else:
                    flight.throughput = wp.cw_mul(carried, wp.vec3(1.0) - real) / (1.0 - chance)
                    if not scatters:
                        passed = wp.cw_mul(flight.throughput, transmittance(extinction, walk.passed))
                        factor = roulette_factor(wp.max(passed), faint, u)
                        flight.throughput = flight.throughput * factor
                        if factor == 0.0:
                            walk.t_end = walk.t
                    numbers = stream_4d(key, collisions)
                    u = numbers[0]
                    walk.depth_left = optical_depth_to_collision(numbers[1])
                    collisions += 1
        flight.throughput = wp.cw_mul(flight.throughput, transmittance(extinction, walk.passed))
        return flight

    return fly_in_grid


@specialised("media", "grid_media")
def make_shadow_in_media(features: Features) -> wp.Function:
    """Return (scene, ray, begin, end, inside, u, number) -> vec3: the share of light left along part of a shadow ray.

    That part is within the bodies `inside`. In a medium on a grid the share is an estimate, by the random numbers of
    the stream `number` of `u`.
    """
    fly_in_grid, extinction_of = make_fly_in_grid(features.media), make_extinction(features.media)

    @wp.func
    def shadow_in_media(
        scene: SceneData, ray: Ray, begin: float, end: float, inside: BodyStack, u: wp.vec4, number: int
    ) -> wp.vec3:
        length = end - begin
        if wp.static(features.grid_media):
            medium = medium_of(scene, inside)
            if is_in_grid(scene, medium):
                key = stream_key(u, number)
                first = stream_4d(key, -1)
                stretch = ray
                stretch.origin = ray.origin + ray.direction * begin
                white = wp.vec3(1.0)
                u_first = wp.vec2(first[0], first[1])
                flight = fly_in_grid(scene, scene.media[medium], stretch, length, white, u_first, key, True)
                return flight.throughput
        return transmittance(extinction_of(scene, inside), length)

    return shadow_in_media
