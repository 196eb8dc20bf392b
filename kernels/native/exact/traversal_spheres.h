#pragma once
// A single ray through a tree of triangles and spheres.
#include "exact/with_spheres.h"
#include "traversal.h"
