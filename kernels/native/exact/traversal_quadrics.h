#pragma once
// A single ray through a tree of triangles, spheres, disks and cylinders.
#include "exact/with_quadrics.h"
#include "traversal.h"
