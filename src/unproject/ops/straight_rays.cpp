// Sums of volumes along straight rays, and their gradients; straight_rays.py has the formula and the plain reference.
//
// A volume is copied into a larger one whose margins are 0, so that no sample near a face needs a test of its own.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "status.h"

namespace {

template <class T>
struct Padded {
    int64_t size[3], stride[3];
    std::vector<T> cells;

    // One cell of margin below, and two above: rounding may place a sample at the end of a ray in the second.
    Padded(int64_t x, int64_t y, int64_t z)
        : size{x, y, z}, stride{(y + 3) * (z + 3), z + 3, 1}, cells(size_t((x + 3) * (y + 3) * (z + 3))) {}

    T* row(int64_t x, int64_t y) { return cells.data() + (x + 1) * stride[0] + (y + 1) * stride[1] + 1; }

    void load(const T* volume) {
        for (int64_t x = 0; x < size[0]; ++x)
            for (int64_t y = 0; y < size[1]; ++y, volume += size[2]) std::copy(volume, volume + size[2], row(x, y));
    }

    void store(T* volume) {
        for (int64_t x = 0; x < size[0]; ++x)
            for (int64_t y = 0; y < size[1]; ++y, volume += size[2]) std::copy(row(x, y), row(x, y) + size[2], volume);
    }
};

// The samples of a ray that lie between the outermost centres of the padded volume, in cells: from + k step.
template <class T>
struct Ray {
    T from[3], step[3];
    int32_t first, last;
    bool sound = true;  // without NaN or infinity, whose place is in no cell

    Ray(const T* origin, const T* direction, const int64_t* size, int64_t samples, T half_depth) {
        const T nearest = half_depth * T(samples - 1) / T(samples), spacing = -2 * half_depth / T(samples);
        T low = 0, high = T(samples - 1);
        for (int i = 0; i < 3; ++i) {
            const T scale = T(size[i]) / 2, end = T(size[i] + 1);
            from[i] = (origin[i] + nearest * direction[i] + 1) * scale + T(0.5);
            step[i] = spacing * direction[i] * scale;
            sound = sound && std::isfinite(from[i]) && std::isfinite(step[i]);
            if (std::abs(step[i]) < T(1e-12)) {  // parallel to the faces
                if (from[i] < 0 || from[i] > end) high = -1;
                continue;
            }
            const T a = -from[i] / step[i], b = (end - from[i]) / step[i];
            low = std::max(low, std::min(a, b)), high = std::min(high, std::max(a, b));
        }
        if (!sound) high = -1;
        first = int32_t(std::ceil(std::min(low, T(samples)))), last = high < 0 ? -1 : int32_t(std::floor(high));
    }
};

template <class T>
struct Cell {
    int64_t at;
    T x, y, z;  // inside the cell, in [0, 1)

    Cell(const Ray<T>& ray, const int64_t* stride, int32_t k) {
        const T px = ray.from[0] + T(k) * ray.step[0], py = ray.from[1] + T(k) * ray.step[1];
        const T pz = ray.from[2] + T(k) * ray.step[2];
        const int32_t ix = int32_t(px), iy = int32_t(py), iz = int32_t(pz);
        at = ix * stride[0] + iy * stride[1] + iz;
        x = px - T(ix), y = py - T(iy), z = pz - T(iz);
    }
};

template <class T>
inline T mix(T a, T b, T share) { return a + share * (b - a); }

template <class T>
T sum(const Padded<T>& volume, const Ray<T>& ray) {
    const int64_t sx = volume.stride[0], sy = volume.stride[1];
    T total = 0;
    for (int32_t k = ray.first; k <= ray.last; ++k) {
        const Cell<T> c(ray, volume.stride, k);
        const T* v = volume.cells.data() + c.at;
        const T a = mix(mix(v[0], v[1], c.z), mix(v[sy], v[sy + 1], c.z), c.y);
        const T b = mix(mix(v[sx], v[sx + 1], c.z), mix(v[sx + sy], v[sx + sy + 1], c.z), c.y);
        total += mix(a, b, c.x);
    }
    return total;
}

template <class T>
void spread(Padded<T>& volume, const Ray<T>& ray, T value) {
    const int64_t sx = volume.stride[0], sy = volume.stride[1];
    for (int32_t k = ray.first; k <= ray.last; ++k) {
        const Cell<T> c(ray, volume.stride, k);
        T* v = volume.cells.data() + c.at;
        const T b = value * c.x, a = value - b, ab = a * c.y, aa = a - ab, bb = b * c.y, ba = b - bb;
        v[0] += aa * (1 - c.z), v[1] += aa * c.z;
        v[sy] += ab * (1 - c.z), v[sy + 1] += ab * c.z;
        v[sx] += ba * (1 - c.z), v[sx + 1] += ba * c.z;
        v[sx + sy] += bb * (1 - c.z), v[sx + sy + 1] += bb * c.z;
    }
}

// The derivatives of the sum by the origin of the ray, and by its direction.
template <class T>
void slope(const Padded<T>& volume, const Ray<T>& ray, int64_t samples, T half_depth, T* origin, T* direction) {
    const int64_t sx = volume.stride[0], sy = volume.stride[1];
    T by[3] = {0, 0, 0}, along[3] = {0, 0, 0};
    for (int32_t k = ray.first; k <= ray.last; ++k) {
        const Cell<T> c(ray, volume.stride, k);
        const T* v = volume.cells.data() + c.at;
        const T aa = mix(v[0], v[1], c.z), ab = mix(v[sy], v[sy + 1], c.z);
        const T ba = mix(v[sx], v[sx + 1], c.z), bb = mix(v[sx + sy], v[sx + sy + 1], c.z);
        const T low = mix(v[1] - v[0], v[sy + 1] - v[sy], c.y);
        const T high = mix(v[sx + 1] - v[sx], v[sx + sy + 1] - v[sx + sy], c.y);
        const T g[3] = {mix(ba, bb, c.y) - mix(aa, ab, c.y), mix(ab - aa, bb - ba, c.x), mix(low, high, c.x)};
        const T w = half_depth * T(samples - 1 - 2 * k) / T(samples);
        for (int i = 0; i < 3; ++i) by[i] += g[i], along[i] += w * g[i];
    }
    for (int i = 0; i < 3; ++i) {
        const T scale = T(volume.size[i]) / 2;
        origin[i] = by[i] * scale, direction[i] = along[i] * scale;
    }
}

struct Job {
    void *volume, *origin, *direction, *sums, *of_origin, *of_direction;
    int64_t batch, x, y, z, rays, samples;
    double half_depth;
};

template <class T, int task>
void run(const Job& job) {
    T *volumes = static_cast<T*>(job.volume), *sums = static_cast<T*>(job.sums);
    const T *origins = static_cast<T*>(job.origin), *directions = static_cast<T*>(job.direction);
    T *of_origin = static_cast<T*>(job.of_origin), *of_direction = static_cast<T*>(job.of_direction);
    Padded<T> volume(job.x, job.y, job.z);
    for (int64_t b = 0; b < job.batch; ++b) {
        T* place = volumes + b * job.x * job.y * job.z;
        if (task == 1) std::fill(volume.cells.begin(), volume.cells.end(), T(0));
        else volume.load(place);
        for (int64_t r = b * job.rays; r < (b + 1) * job.rays; ++r) {
            if (task == 1 && sums[r] == 0) continue;
            const Ray<T> ray(origins + 3 * r, directions + 3 * r, volume.size, job.samples, T(job.half_depth));
            if (task == 0) sums[r] = ray.sound ? sum(volume, ray) : T(NAN);
            if (task == 1) spread(volume, ray, sums[r]);
            if (task == 2) slope(volume, ray, job.samples, T(job.half_depth), of_origin + 3 * r, of_direction + 3 * r);
        }
        if (task == 1) volume.store(place);
    }
}

}  // namespace

extern "C" int sum_float(const Job* job) { return status_of([=] { run<float, 0>(*job); }); }
extern "C" int sum_double(const Job* job) { return status_of([=] { run<double, 0>(*job); }); }
extern "C" int spread_float(const Job* job) { return status_of([=] { run<float, 1>(*job); }); }
extern "C" int spread_double(const Job* job) { return status_of([=] { run<double, 1>(*job); }); }
extern "C" int slope_float(const Job* job) { return status_of([=] { run<float, 2>(*job); }); }
extern "C" int slope_double(const Job* job) { return status_of([=] { run<double, 2>(*job); }); }
