"""Options of `wrt render` on what a picture shows of its input: size, view, material, light and background."""

from __future__ import annotations

import argparse

from wrt.cli.arguments.types import crop, material, size, view, whole


def add_studio_options(parser: argparse.ArgumentParser) -> None:
    """Add the options to a parser."""
    add = parser.add_argument
    add("--size", metavar="WxH", type=size, help="resolution: 640x480, 720p, 1080p or 4k (default: from the scene)")
    add("--crop", metavar="X0,Y0,X1,Y1", type=crop, help="render only columns X0 to X1-1 and rows Y0 to Y1-1")
    add(
        "--view",
        metavar="VIEW",
        type=view,
        help="where to look from: AZIMUTH,ELEVATION in degrees, front, right, back, left, top, bottom or three-quarter",
    )
    add(
        "--frame",
        action=argparse.BooleanOptionalAction,
        help="ignore the input's camera, and frame what it shows; --no-frame keeps a camera that shows a mesh small",
    )
    add(
        "--material", metavar="NAME", type=material, help="material of a mesh, such as gold, glass or diffuse:0.8,0.2,0"
    )
    add("--environment", metavar="FILE", help="image that lights the scene, such as an .hdr, or sky for sun and sky")
    add("--transparent", action="store_true", help="no backdrop: the picture has an alpha channel")
    add("--layers", metavar="NAMES", help="layers to add to an .exr: albedo, normal, depth and others (see the docs)")
    add("--triangles", metavar="N", type=whole(1), help="number of triangles of a procedural mesh")
