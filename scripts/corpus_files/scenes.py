"""Scene files: those of wrt, and of Mitsuba 3."""

from __future__ import annotations

TOML_SHAPES = """\
[settings]
width = 64
height = 48
spp = 1
filter = "gaussian"
sampler = "sobol"
crop = [0, 0, 32, 24]
layers = ["albedo", "normal"]

[camera]
type = "perspective"
origin = [0, 1, 4]
target = [0, 0, 0]
fov_degrees = 40
aperture_radius = 0.01
focus_distance = 3.0
motion = { keys = [{ time = 0.0 }, { time = 1.0, translate = [1, 0, 0] }] }

[environment]
type = "image"
file = "sky.hdr"
scale = 0.5
rotation_degrees = 30

[[lights]]
type = "point"
position = [1, 2, 3]
intensity = [10, 9, 8]

[[lights]]
type = "spot"
position = [0, 3, 0]
direction = [0, -1, 0]
intensity = 20
inner_degrees = 10
outer_degrees = 20

[materials.wood]
type = "diffuse"
reflectance = { texture = "colors.png", scale = 2, rotation_degrees = 15, wrap = "mirror" }
normal_map = { texture = "grey.png", scale = 0.5 }

[materials.gold]
type = "rough-conductor"
alpha = 0.2

[materials.both]
type = "mix"
first = "wood"
second = "gold"
weight = 0.5

[[shapes]]
name = "floor"
type = "quad"
origin = [-1, 0, -1]
edge_u = [0, 0, 2]
edge_v = [2, 0, 0]
material = "both"

[[shapes]]
type = "box"
low = [-1, 0, -1]
high = [1, 1, 1]
scale = [1, 2, 1]
rotate = [{ axis = [0, 1, 0], degrees = 30 }]
translate = [0, 1, 0]

[[shapes]]
type = "sphere"
center = [0, 1, 0]
radius = 0.5
subdivisions = 2
emission = [1, 2, 3]
two_sided_emission = true

[[shapes]]
type = "polygons"
polygons = [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]]

[[shapes]]
type = "mesh"
file = "box.off"
smooth = false
material = "gold"
instances = [{ translate = [2, 0, 0] }, { scale = 2, motion = { keys = [{ time = 0 }, { time = 1, scale = 2 }] } }]
"""
TOML_SKY = """\
[environment]
type = "sun-sky"
elevation_degrees = 40
turbidity = 3

[[lights]]
type = "directional"
direction = [0, -1, 0]
irradiance = 2.0

[[shapes]]
type = "many-triangles"
triangles = 1000

[[shapes]]
type = "polygon"
corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
material = "pane"

[materials.pane]
type = "thin-dielectric"
"""
XML_SCENE = """\
<scene version="3.0.0">
  <default name="spp" value="4"/>
  <integrator type="path"><integer name="max_depth" value="6"/></integrator>
  <sensor type="thinlens">
    <float name="fov" value="40"/>
    <float name="aperture_radius" value="0.01"/>
    <float name="focus_distance" value="4"/>
    <transform name="to_world"><lookat origin="0, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="24"/>
    <rfilter type="tent"/></film>
    <sampler type="independent"><integer name="sample_count" value="$spp"/></sampler>
  </sensor>
  <bsdf type="twosided" id="wood"><bsdf type="diffuse">
    <texture type="bitmap" name="reflectance"><string name="filename" value="colors.png"/></texture>
  </bsdf></bsdf>
  <bsdf type="roughconductor" id="gold"><string name="material" value="Au"/><float name="alpha" value="0.2"/></bsdf>
  <bsdf type="principled" id="paint"><rgb name="base_color" value="0.8, 0.3, 0.1"/>
    <float name="roughness" value="0.4"/></bsdf>
  <shape type="sphere"><point name="center" x="0" y="1" z="0"/><float name="radius" value="0.5"/>
    <ref id="gold"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/><translate y="-1"/></transform>
    <ref id="wood"/>
  </shape>
  <shape type="cylinder"><point name="p0" value="0 0 0"/><point name="p1" value="0 1 0"/><ref id="paint"/></shape>
  <shape type="ply"><string name="filename" value="little.ply"/><bsdf type="dielectric"/></shape>
  <shape type="obj"><string name="filename" value="polygons.obj"/><boolean name="face_normals" value="true"/></shape>
  <shape type="disk"><emitter type="area"><spectrum name="radiance" value="400:1, 700:5"/></emitter></shape>
  <emitter type="envmap"><string name="filename" value="sky.hdr"/><float name="scale" value="0.5"/></emitter>
  <emitter type="point"><point name="position" x="1" y="2" z="3"/><rgb name="intensity" value="#ff8000"/></emitter>
  <include filename="lamp.xml"/>
</scene>
"""
XML_INCLUDED = """\
<scene version="3.0.0">
  <shape type="shapegroup" id="group"><shape type="cube"/></shape>
  <shape type="instance"><ref id="group"/><transform name="to_world"><translate x="2"/></transform></shape>
  <emitter type="spot"><rgb name="intensity" value="3"/><float name="cutoff_angle" value="25"/></emitter>
</scene>
"""

FILES: dict[str, str | bytes] = {
    "shapes.toml": TOML_SHAPES,
    "sky.toml": TOML_SKY,
    "plugins.xml": XML_SCENE,
    "lamp.xml": XML_INCLUDED,
}
"""The content of each file by its name."""
