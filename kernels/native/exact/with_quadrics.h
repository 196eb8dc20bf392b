#pragma once
// Included before traversal in modules whose trees hold disks and cylinders, too (`quadrics.h`).
#include "exact/with_spheres.h"
#define WRT_QUADRICS 1
