#pragma once
// Included before traversal in modules whose trees hold spheres, too (`spheres.h`).
#define WRT_SPHERES 1
