#pragma once
// Two-level traversal of meshes with triangles and spheres.
#include "exact/with_spheres.h"
#include "instances.h"
