#pragma once
// Included before traversal in modules whose trees hold boxes of distance functions, too (`quadrics.h`).
#include "exact/with_quadrics.h"
#define WRT_BOXES 1
