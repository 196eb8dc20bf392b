#pragma once
// Vertex normals of a mesh with creases (`kernels/files/creases.py`), by the operations of `wrt/scene/normals.py` in
// their order.
#include "vectors.h"

namespace wrt {
constexpr int MOST_CORNERS = 512;

// Lists the corners of all positions, those of each in ascending order.
template<class Mesh> WRT_INLINE void list_corners(const Mesh& mesh) {
    int* begins = mesh.begins.data;
    const int count = mesh.faces.shape[0], positions = mesh.begins.shape[0] - 2;
    for (int k = 0; k < count; ++k) ++begins[mesh.positions.data[mesh.faces.data[k]] + 2];
    for (int k = 2; k < positions + 2; ++k) begins[k] += begins[k - 1];
    for (int k = 0; k < count; ++k) mesh.corners.data[begins[mesh.positions.data[mesh.faces.data[k]] + 1]++] = k;
}

WRT_INLINE int root_of(const int* parents, int i) {
    while (parents[i] != i) i = parents[i];
    return i;
}

// The unit normal of a corner's face, zero without an area, and the angle there, as four numbers.
template<class Mesh> WRT_INLINE void face_at(const Mesh& mesh, const int corner, double* out) {
    WRT_NO_CONTRACTION
    double points[3][3], edges[3][3];
    const int* face = mesh.faces.data + corner / 3 * 3;
    for (int k = 0; k < 3; ++k)
        for (int q = 0; q < 3; ++q)
            points[k][q] = ((double)mesh.vertices.data[3 * (size_t)face[k] + q] - mesh.origin[q]) / mesh.scale;
    for (int k = 0; k < 3; ++k)
        for (int q = 0; q < 3; ++q) edges[k][q] = points[(k + 1) % 3][q] - points[k][q];
    const double *u = edges[0], v[3] = {-edges[2][0], -edges[2][1], -edges[2][2]};
    const double x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2], z = u[0] * v[1] - u[1] * v[0];
    const double area = wp::sqrt(x * x + y * y + z * z), length = area > 0.0 ? area : 1.0;
    const double *a = edges[corner % 3], *b = edges[(corner + 2) % 3];
    out[0] = x / length;
    out[1] = y / length;
    out[2] = z / length;
    out[3] = wp::atan2(area, -(a[0] * b[0] + a[1] * b[1] + a[2] * b[2]));
}

WRT_INLINE bool is_smooth(const double* n, const double* m, const double least) {
    WRT_NO_CONTRACTION
    const bool has_normals = (n[0] != 0.0 || n[1] != 0.0 || n[2] != 0.0) && (m[0] != 0.0 || m[1] != 0.0 || m[2] != 0.0);
    return !has_normals || n[0] * m[0] + n[1] * m[1] + n[2] * m[2] >= least;
}

// Joins the corners at a position through smooth edges, and computes the normal of each group. Returns false where the
// host must do it: at degenerate faces, where normals cancel, and where very many faces meet.
template<class Mesh> WRT_INLINE bool join_corners(const Mesh& mesh, const int position) {
    WRT_NO_CONTRACTION
    const int begin = mesh.begins.data[position], count = mesh.begins.data[position + 1] - begin;
    if (count > MOST_CORNERS) return false;
    const int* corners = mesh.corners.data + begin;
    double faces[MOST_CORNERS][4], sums[MOST_CORNERS][4];
    int ends[MOST_CORNERS][2], parents[MOST_CORNERS], seen[MOST_CORNERS];
    for (int i = 0; i < count; ++i) {
        const int corner = corners[i], first = corner / 3 * 3;
        for (int k = 0; k < 2; ++k) ends[i][k] = mesh.positions.data[mesh.faces.data[first + (corner + 1 + k) % 3]];
        if (ends[i][0] == position || ends[i][1] == position || ends[i][0] == ends[i][1]) return false;
        face_at(mesh, corner, faces[i]);
        parents[i] = i;
        for (int q = 0; q < 4; ++q) sums[i][q] = 0.0;
    }
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < 2; ++k) {
            int j = i + 1;
            while (j < count && ends[j][0] != ends[i][k] && ends[j][1] != ends[i][k]) ++j;
            if (j == count || !is_smooth(faces[i], faces[j], mesh.least_cosine)) continue;
            const int a = root_of(parents, i), b = root_of(parents, j);
            parents[a > b ? a : b] = a > b ? b : a;
        }
    }
    for (int i = 0; i < count; ++i) {
        double* sum = sums[parents[i] = root_of(parents, i)];
        for (int q = 0; q < 3; ++q) sum[q] += faces[i][q] * faces[i][3];
        sum[3] += faces[i][3];
        seen[i] = -1;
    }
    for (int i = 0; i < count; ++i) {
        if (parents[i] == i) {
            const double* sum = sums[i];
            const double length = wp::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
            if (!(length > 1e-6 * sum[3])) return false;
            for (int q = 0; q < 3; ++q) mesh.normals.data[3 * (size_t)(begin + i) + q] = (float)(sum[q] / length);
        }
        // The copy of the vertex: how many groups of its corners have a lower corner.
        const int vertex = mesh.faces.data[corners[i]];
        int copy = 0;
        for (int j = 0; j < count; ++j) {
            const int group = parents[j];
            if (group >= parents[i] || seen[group] == i || mesh.faces.data[corners[j]] != vertex) continue;
            seen[group] = i;
            ++copy;
        }
        mesh.copies.data[corners[i]] = copy;
        mesh.sources.data[corners[i]] = begin + parents[i];
        if (copy >= mesh.counts.data[vertex]) mesh.counts.data[vertex] = copy + 1;
    }
    return true;
}
} // namespace wrt
