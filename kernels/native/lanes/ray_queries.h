#pragma once
// Ray queries of paths, for all groups of a pool.
//
// The translator writes a type for each query (`wrt/spmd/ray_queries.py`): its rays, its scene, the greatest distance,
// and the place for the answers. It derives from one of the types here, which trace the rays. The rays that leave their
// groups are interleaved, whichever group they left. Among instances that move each group is traced by itself.
#include "lanes/instances.h"

namespace lanes {
// Scenes with one tree: starts a group, and follows the rays that leave any group.
struct InOneTree {
    typedef Journeys Traced;
    template<bool any_hit, class Scene, class Ray>
    static void set_out(const Scene& scene, Traced& t, const Ray& ray, Floats reach, Mask exec) {
        const wrt::Axes axes = wrt::axes_of(scene.corners, scene.normals);
        lanes::set_out(scene.bvh, axes, t, ray.origin, ray.direction, reach, any_hit, exec);
    }
    template<bool any_hit, class Scene> static void follow(const Scene& scene, Traced* t, int count) {
        follow_alone<any_hit>(scene.bvh, t, count);
    }
    template<class Scene> static auto found(const Scene&, const Traced& t, Floats reach) {
        return lanes::found(t, reach);
    }
};
// Scenes with instances that do not move.
struct InInstances {
    typedef InstanceJourneys Traced;
    template<bool any_hit, class Scene, class Ray>
    static void set_out(const Scene& scene, Traced& t, const Ray& ray, Floats reach, Mask exec) {
        const wrt::Axes axes = wrt::axes_of(scene.corners, scene.normals);
        lanes::set_out<any_hit>(scene.placed, axes, t, ray.origin, ray.direction, reach, exec);
    }
    template<bool any_hit, class Scene> static void follow(const Scene& scene, Traced* t, int count) {
        follow_alone<any_hit>(scene.placed, wrt::axes_of(scene.corners, scene.normals), t, count);
    }
    template<class Scene> static auto found(const Scene& scene, const Traced& t, Floats reach) {
        return lanes::found(scene.placed, t, reach);
    }
};
template<class RayQuery, class Trees, bool any_hit> struct AskedTogether {
    typedef typename Trees::Traced Traced;
    template<class Steps, class Ray>
    static void set_out(const Steps& steps, Traced& t, const Ray& ray, Floats reach, Mask exec) {
        Trees::template set_out<any_hit>(RayQuery::scene(steps), t, ray, reach, exec);
    }
    template<class Steps> static void follow(const Steps& steps, Traced* t, int count) {
        Trees::template follow<any_hit>(RayQuery::scene(steps), t, count);
    }
};

// The nearest hit. The data of the triangles that were hit are prefetched.
template<class RayQuery, class Trees> struct NearestTogether : AskedTogether<RayQuery, Trees, false> {
    template<class Steps, class RayOf>
    static auto found(const Steps& steps, const typename Trees::Traced& t, RayOf, Floats reach, Mask exec) {
        const auto& scene = RayQuery::scene(steps);
        const auto hits = RayQuery::as_hit(Trees::found(scene, t, reach), exec);
        if (scene.points.shape[0] > wrt::POINTS_IN_CACHE) LANES_EACH(l, exec) {
            const size_t triangle = hits.triangle.v[l] < 0 ? 0 : hits.triangle.v[l];
            __builtin_prefetch((const int*)scene.corners.data + 3 * triangle);
            __builtin_prefetch((const int*)scene.triangle_shape.data + triangle);
        }
        return hits;
    }
    template<class Steps> static void prepare(Steps& steps, const Mask exec) {
        const auto& scene = RayQuery::scene(steps);
        if (scene.points.shape[0] > wrt::POINTS_IN_CACHE) LANES_EACH(l, exec) {
            const auto& hits = RayQuery::answer(steps);
            const size_t triangle = hits.triangle.v[l] < 0 ? 0 : hits.triangle.v[l];
            const int* const corners = (const int*)scene.corners.data + 3 * triangle;
            for (int k = 0; k < 3; ++k) __builtin_prefetch((const float*)scene.points.data + 3 * (size_t)corners[k]);
        }
    }
};

// Whether there is any hit.
template<class RayQuery, class Trees> struct AnyTogether : AskedTogether<RayQuery, Trees, true> {
    template<class Steps, class RayOf>
    static Ints found(const Steps& steps, const typename Trees::Traced& t, RayOf, Floats reach, Mask) {
        return cast_int32(Trees::found(RayQuery::scene(steps), t, reach).c[0]);
    }
    template<class Steps> static void prepare(Steps&, Mask) {}
};

// Either, where the tree has boxes of distance functions.
template<class RayQuery, class Trees, bool any_hit> struct SurfacesTogether : AskedTogether<RayQuery, Trees, any_hit> {
    template<class Steps, class RayOf>
    static auto found(const Steps& steps, const typename Trees::Traced& t, RayOf ray_of, Floats reach, Mask exec) {
        return RayQuery::surface(steps, ray_of(), Trees::found(RayQuery::scene(steps), t, reach), exec);
    }
    template<class Steps> static void prepare(Steps&, Mask) {}
};

// Each group by itself.
template<class RayQuery, class Answer> struct AskedEach {
    typedef Answer Traced;
    template<class Steps, class Ray>
    static void set_out(const Steps& steps, Traced& t, const Ray& ray, Floats reach, Mask exec) {
        t = RayQuery::ask(steps, ray, reach, exec);
    }
    template<class Steps> static void follow(const Steps&, Traced*, int) {}
    template<class Steps, class RayOf>
    static Answer found(const Steps&, const Traced& t, RayOf, Floats, Mask) {
        return t;
    }
    template<class Steps> static void prepare(Steps&, Mask) {}
};
} // namespace lanes
