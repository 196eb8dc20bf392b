#pragma once
// Two-level traversal of meshes with triangles and spheres.
#include "with_spheres.h"
#include "instances.h"
