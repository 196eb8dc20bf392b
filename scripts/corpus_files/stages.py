"""Files of USD: as text, in binary form, and as an archive with an image."""

from __future__ import annotations

import tempfile
from pathlib import Path

TEXT = """\
#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 0.5
    upAxis = "Z"
)

def Xform "World"
{
    def Mesh "Square" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        int[] faceVertexCounts = [4, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 2]
        point3f[] points = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (3, 1, 1)]
        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0.6, 0.8)] (
            interpolation = "vertex"
        )
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (
            interpolation = "faceVarying"
        )
        int[] primvars:st:indices = [0, 1, 2, 3, 1, 0, 2]
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (
            interpolation = "uniform"
        )
        rel material:binding = </World/Paint>
        uniform token subdivisionScheme = "none"

        def GeomSubset "Second" (
            prepend apiSchemas = ["MaterialBindingAPI"]
        )
        {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1]
            rel material:binding = </World/Plain>
        }
    }

    def Material "Paint"
    {
        token outputs:surface.connect = </World/Paint/Surface.outputs:surface>
        float inputs:shine = 0.25

        def Shader "Surface"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </World/Paint/Image.outputs:rgb>
            float inputs:roughness.connect = </World/Paint.inputs:shine>
            float inputs:metallic = 1
            token outputs:surface
        }

        def Shader "Image"
        {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @colors.png@
            token inputs:wrapS = "mirror"
            float4 inputs:scale = (0.5, 0.5, 0.5, 1)
            float2 inputs:st.connect = </World/Paint/Turn.outputs:result>
            float3 outputs:rgb
        }

        def Shader "Turn"
        {
            uniform token info:id = "UsdTransform2d"
            float2 inputs:in.connect = </World/Paint/Reader.outputs:result>
            float inputs:rotation = 30
            float2 inputs:scale = (3, 2)
            float2 outputs:result
        }

        def Shader "Reader"
        {
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }
    }

    def Material "Plain"
    {
        token outputs:surface.connect = </World/Plain/Surface.outputs:surface>

        def Shader "Surface"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0.1, 0.2, 0.3)
            color3f inputs:emissiveColor = (1, 0.5, 0)
            float inputs:clearcoat = 0.5
            float inputs:opacity = 0.75
            token outputs:surface
        }
    }

    class Xform "Ball"
    {
        def Sphere "Sphere"
        {
            double radius = 0.5
        }
    }

    def "First" (
        instanceable = true
        inherits = </World/Ball>
        variants = {
            string size = "large"
        }
        prepend variantSets = "size"
    )
    {
        double3 xformOp:translate = (2, 0, 1)
        double3 xformOp:scale = (1, 2, 1)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
        variantSet "size" = {
            "large" {
                custom double width = 2
            }
            "small" (
                references = </World/Square>
            ) {
            }
        }
    }

    def "Second" (
        instanceable = true
        references = </World/Ball>
    )
    {
        float xformOp:rotateX = 45
        uniform token[] xformOpOrder = ["xformOp:rotateX"]
    }

    def PointInstancer "Posts"
    {
        int[] protoIndices = [0, 0, 1]
        point3f[] positions = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), (0, 1, 0, 0)]
        int64[] invisibleIds = [1]
        rel prototypes = [</World/Posts/Post>, </World/Posts/Cap>]

        def Cylinder "Post"
        {
            uniform token axis = "Y"
            double radius = 0.1
        }

        def Cone "Cap"
        {
            double height = 0.5
        }
    }

    def Camera "Eye"
    {
        float focalLength = 50
        float verticalAperture = 20
        float fStop = 2.8
        float focusDistance = 4
        double3 xformOp:translate = (1, 1, 10)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def RectLight "Panel"
    {
        float inputs:width = 2
        float inputs:height = 1
        float inputs:intensity = 3
        float inputs:exposure = 1
        bool inputs:enableColorTemperature = true
    }

    def SphereLight "Lamp"
    {
        float inputs:radius = 0.5
        bool inputs:normalize = true
    }

    def DiskLight "Spot"
    {
    }

    def DistantLight "Sun"
    {
        float inputs:angle = 0.53
    }

    def DomeLight "Sky"
    {
        asset inputs:texture:file = @light.exr@
    }
}
"""


def write_stages(folder: Path) -> None:
    """Write the stage in each form; `colors.png` and `light.exr` lie in the folder."""
    from pxr import Sdf, UsdUtils

    (folder / "stage.usda").write_text(TEXT)
    Sdf.Layer.FindOrOpen(str(folder / "stage.usda")).Export(str(folder / "stage.usdc"))
    with tempfile.TemporaryDirectory() as name:
        source = Path(name, "stage.usda")
        source.write_text(TEXT.replace("@light.exr@", "@@"))
        (source.parent / "colors.png").write_bytes((folder / "colors.png").read_bytes())
        UsdUtils.CreateNewUsdzPackage(str(source), str(folder / "stage.usdz"))
