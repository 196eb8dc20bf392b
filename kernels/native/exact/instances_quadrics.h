#pragma once
// Two-level traversal of meshes with triangles, spheres, disks and cylinders.
#include "exact/with_quadrics.h"
#include "instances.h"
