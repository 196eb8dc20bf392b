"""Shapes that rays meet by formula: spheres, disks and open cylinders."""
