#pragma once
// The headers that the code of wide kernels begins with.
#include "lanes/light_boxes.h"
#include "lanes/lights.h"
#include "lanes/low_discrepancy.h"
#include "lanes/ray_queries.h"
