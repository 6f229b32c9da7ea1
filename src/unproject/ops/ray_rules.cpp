// Occupancy rules along the rays of orthographic cameras; ray_rules.py has the formulas and the plain reference.
//
// Samples of one place (x, z) at all heights lie side by side, so that all heights of a ray are worked on at once. A
// volume is copied into a larger one whose margins are 0, so that no sample near a face needs a test of its own.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "status.h"

// All that a loop over heights writes is apart from what it reads, which compilers cannot know.
#define APART _Pragma("GCC ivdep")

namespace {

enum Rule { SAMPLES, SUM, ANY, ALPHA };
enum Task { FORWARD, BACK, SLOPE };

constexpr double TRANSPARENCY = 1e-6, ROUNDING = 1e-4;
constexpr int64_t BLOCK = 16;

struct Job {
    void *volume, *values, *gradient, *passed, *cosine, *sine, *viewport, *offset;
    int64_t batch, x, y, z, size, samples, of_item, of_x, of_y, of_z;
    int64_t per_item, per_pixel, per_sample, per_height;  // strides of values
    double half_depth, half_width, half_length;
};

// Copy rows of elements that may be anywhere to rows that lie one after another.
template <class T>
void copy_rows(const T* from, int64_t rows, int64_t length, int64_t per_row, int64_t per_element, T* to) {
    if (per_element == 1) {
        for (int64_t r = 0; r < rows; ++r) std::copy_n(from + r * per_row, length, to + r * length);
        return;
    }
    for (int64_t r0 = 0; r0 < rows; r0 += BLOCK)  // in blocks: one of the two orders is far apart in memory
        for (int64_t i0 = 0; i0 < length; i0 += BLOCK)
            for (int64_t r = r0; r < std::min(r0 + BLOCK, rows); ++r)
                for (int64_t i = i0; i < std::min(i0 + BLOCK, length); ++i)
                    to[r * length + i] = from[r * per_row + i * per_element];
}

template <class T>
struct Columns {
    int64_t x, y, z;
    std::vector<T> cells;

    Columns(int64_t x, int64_t y, int64_t z) : x(x), y(y), z(z), cells(size_t((x + 2) * (z + 2) * y)) {}

    int64_t place(int64_t ix, int64_t iz) const { return ((ix + 1) * (z + 2) + iz + 1) * y; }

    void load(const T* volume, const Job& job) {
        for (int64_t ix = 0; ix < x; ++ix, volume += job.of_x)
            copy_rows(volume, z, y, job.of_z, job.of_y, &cells[place(ix, 0)]);
    }

    void store(T* volume) const {
        for (int64_t ix = 0; ix < x; ++ix)
            for (int64_t iz = 0; iz < z; ++iz, volume += y) std::copy_n(&cells[place(ix, iz)], y, volume);
    }
};

// A sample: the first of the four places around it, its place within them, and how that moves with the angle.
template <class T>
struct Sample {
    int64_t k, at;
    T x, z, x_slope, z_slope;
};

// Call f with the samples inside the volume of the ray of a pixel, nearest first; return if the ray is sound.
template <class T, class F>
bool trace(const Job& job, const Columns<T>& columns, int64_t b, int64_t pixel, F f) {
    const T c = static_cast<T*>(job.cosine)[b], s = static_cast<T*>(job.sine)[b];
    const T width = T(job.x), depth = T(job.z), half_width = T(job.half_width), half_length = T(job.half_length);
    const T count = T(job.samples), size = T(job.size);
    const T u = static_cast<T*>(job.viewport)[b] * ((T(2 * pixel + 1) - size) / size) + static_cast<T*>(job.offset)[b];
    const T x = ((u * c / half_width + 1) * width - 1) / 2, z = ((1 - u * s / half_length) * depth - 1) / 2;
    if (!std::isfinite(x) || !std::isfinite(z)) return false;
    for (int64_t k = 0; k < job.samples; ++k) {
        const T w = -T(job.half_depth) * ((T(2 * k + 1) - count) / count);
        const T px = x + w * s / half_width * width / 2, pz = z + w * c / half_length * depth / 2;
        if (!(px > -1 && px < width && pz > -1 && pz < depth)) continue;
        const T ix = std::floor(px), iz = std::floor(pz);
        f(Sample<T>{k, columns.place(int64_t(ix), int64_t(iz)), px - ix, pz - iz,
                    (w * c - u * s) / half_width * width / 2, -(u * c + w * s) / half_length * depth / 2});
    }
    return true;
}

// The four places of a sample, at all heights.
template <class P>
struct Corners {
    P a, b, c, d;
    Corners(P cells, int64_t at, int64_t y, int64_t row) : a(cells + at), b(a + y), c(a + row), d(c + y) {}
};

template <class T>
struct Weights {
    T a, b, c, d;
    explicit Weights(const Sample<T>& p)
        : a((1 - p.x) * (1 - p.z)), b((1 - p.x) * p.z), c(p.x * (1 - p.z)), d(p.x * p.z) {}
};

template <class T, Rule rule>
void forward(const Job& job, const Columns<T>& columns, int64_t b, int64_t pixel, T* values, T* running) {
    const int64_t y = job.y, row = (job.z + 2) * y, count = rule == SAMPLES ? job.samples * y : y;
    std::fill_n(values, count, T(rule == ANY));
    std::fill_n(running, y, T(0));
    const bool sound = trace(job, columns, b, pixel, [&](const Sample<T>& p) {
        const Corners<const T*> v(columns.cells.data(), p.at, y, row);
        const Weights<T> w(p);
        T* out = values + (rule == SAMPLES ? p.k * y : 0);
        APART for (int64_t i = 0; i < y; ++i) {
            const T q = w.a * v.a[i] + w.b * v.b[i] + w.c * v.c[i] + w.d * v.d[i];
            if (rule == SAMPLES) out[i] = q;
            if (rule == SUM) out[i] += q;
            if (rule == ANY) out[i] *= 1 + q * T(TRANSPARENCY - 1);
            if (rule == ALPHA) running[i] += q, out[i] += running[i] <= T(1 + ROUNDING) ? q : T(0);
        }
    });
    if (!sound) std::fill_n(values, count, T(NAN));
}

// The derivative of ⟨values, of⟩ by a sample, of which `passed` is Π (1 - p) of the ray, of "any".
template <class T, Rule rule>
inline T pull(T q, T of, T passed, T& running) {
    if (rule == ANY) return of * passed * T(1 - TRANSPARENCY) / (1 + q * T(TRANSPARENCY - 1));
    if (rule == ALPHA) return running += q, running <= T(1 + ROUNDING) ? of : T(0);
    return of;
}

template <class T, Rule rule>
void back(const Job& job, const Columns<T>& columns, int64_t b, int64_t pixel, const T* of, const T* passed, T* running,
          Columns<T>& gradient) {
    const int64_t y = job.y, row = (job.z + 2) * y;
    if (rule != SAMPLES && std::all_of(of, of + y, [](T g) { return g == 0; })) return;
    std::fill_n(running, y, T(0));
    trace(job, columns, b, pixel, [&](const Sample<T>& p) {
        const Corners<const T*> v(columns.cells.data(), p.at, y, row);
        const Corners<T*> g(gradient.cells.data(), p.at, y, row);
        const Weights<T> w(p);
        const T* each = of + (rule == SAMPLES ? p.k * y : 0);
        APART for (int64_t i = 0; i < y; ++i) {
            T q = 0;
            if (rule == ANY || rule == ALPHA) q = w.a * v.a[i] + w.b * v.b[i] + w.c * v.c[i] + w.d * v.d[i];
            const T d = pull<T, rule>(q, each[i], rule == ANY ? passed[i] : T(0), running[i]);
            g.a[i] += w.a * d, g.b[i] += w.b * d, g.c[i] += w.c * d, g.d[i] += w.d * d;
        }
    });
}

// The derivative of ⟨values, of⟩ by the angle.
template <class T, Rule rule>
T slope(const Job& job, const Columns<T>& columns, int64_t b, int64_t pixel, const T* of, const T* passed, T* running,
        T* total) {
    const int64_t y = job.y, row = (job.z + 2) * y;
    std::fill_n(running, y, T(0));
    std::fill_n(total, y, T(0));
    trace(job, columns, b, pixel, [&](const Sample<T>& p) {
        const Corners<const T*> v(columns.cells.data(), p.at, y, row);
        const Weights<T> w(p);
        const T* each = of + (rule == SAMPLES ? p.k * y : 0);
        APART for (int64_t i = 0; i < y; ++i) {
            const T q = w.a * v.a[i] + w.b * v.b[i] + w.c * v.c[i] + w.d * v.d[i];
            const T along_x = (v.c[i] - v.a[i]) * (1 - p.z) + (v.d[i] - v.b[i]) * p.z;
            const T along_z = (v.b[i] - v.a[i]) * (1 - p.x) + (v.d[i] - v.c[i]) * p.x;
            const T d = pull<T, rule>(q, each[i], rule == ANY ? passed[i] : T(0), running[i]);
            total[i] += d * (along_x * p.x_slope + along_z * p.z_slope);
        }
    });
    T sum = 0;
    for (int64_t i = 0; i < y; ++i) sum += total[i];
    return sum;
}

template <class T, Rule rule, Task task>
void run(const Job& job) {
    const int64_t y = job.y, samples = rule == SAMPLES ? job.samples : 1;
    Columns<T> columns(job.x, y, job.z), gradient(task == BACK ? job.x : 0, y, task == BACK ? job.z : 0);
    std::vector<T> running(y), total(y), of(samples * y);
    for (int64_t b = 0; b < job.batch; ++b) {
        if (task != BACK || rule == ANY || rule == ALPHA)
            columns.load(static_cast<const T*>(job.volume) + b * job.of_item, job);
        if (task == BACK) std::fill(gradient.cells.begin(), gradient.cells.end(), T(0));
        T angle = 0;
        for (int64_t pixel = 0; pixel < job.size; ++pixel) {
            T* values = static_cast<T*>(job.values) + b * job.per_item + pixel * job.per_pixel;
            const T* passed = static_cast<const T*>(job.passed);
            if (rule == ANY && task != FORWARD) passed += (b * job.size + pixel) * y;
            if (task != FORWARD) copy_rows<T>(values, samples, y, job.per_sample, job.per_height, of.data());
            if (task == FORWARD) forward<T, rule>(job, columns, b, pixel, values, running.data());
            if (task == BACK) back<T, rule>(job, columns, b, pixel, of.data(), passed, running.data(), gradient);
            if (task == SLOPE)
                angle += slope<T, rule>(job, columns, b, pixel, of.data(), passed, running.data(), total.data());
        }
        if (task == BACK) gradient.store(static_cast<T*>(job.gradient) + b * job.x * y * job.z);
        if (task == SLOPE) static_cast<T*>(job.gradient)[b] = angle;
    }
}

}  // namespace

#define RULE(name, rule, T, kind)                                                          \
    extern "C" int name##_forward_##kind(const Job* job) { return status_of([=] { run<T, rule, FORWARD>(*job); }); } \
    extern "C" int name##_back_##kind(const Job* job) { return status_of([=] { run<T, rule, BACK>(*job); }); }       \
    extern "C" int name##_slope_##kind(const Job* job) { return status_of([=] { run<T, rule, SLOPE>(*job); }); }
#define RULES(T, kind) \
    RULE(samples, SAMPLES, T, kind) RULE(sum, SUM, T, kind) RULE(any, ANY, T, kind) RULE(alpha, ALPHA, T, kind)

RULES(float, float)
RULES(double, double)
