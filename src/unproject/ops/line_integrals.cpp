// Line integrals of images and their transpose; line_integrals.py has the formula and the plain reference.
//
// A pixel's footprint is a trapezoid `longer + shorter` wide, in detectors. It begins in detector `start` and overlaps
// `borders + 1` of them; the share left of the k-th border is F(inside + k). Buffers with a margin on either
// side hold what projects outside the detectors.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <vector>

#include "status.h"

// Vectors of gathered elements are slower here than one element after another.
#if defined(__GNUC__) && !defined(__clang__)
#define SCALAR __attribute__((optimize("no-tree-vectorize")))
#else
#define SCALAR
#endif

namespace {

// Neighbouring pixels project to the same detectors; alternating sums do not depend on one another.
constexpr int64_t LANES = 4;

template <class T>
inline T ramp(T t, T width, T half_inverse) {  // the integral of clamp(s / width, 0, 1) up to t
    const T beyond = t > 0 ? t : T(0), reached = beyond < width ? beyond : width;
    return beyond - reached + reached * reached * half_inverse;
}

// `Borders` is a compile-time constant where detectors are as wide as pixels, else an int32_t.
template <class T, class Borders>
struct Shadows {
    int64_t height, width, bins, margin;
    Borders borders;
    T c, s, longer, shorter, half_inverse, inverse;
    std::vector<int32_t> start;
    std::vector<T> share;  // [borders + 1][width]

    Shadows(int64_t height, int64_t width, int64_t bins, Borders borders)
        : height(height), width(width), bins(bins),
          margin(int64_t(std::ceil((diagonal(double(height), double(width)) / double(width) - 1) / 2 * double(bins))) + 2),
          borders(borders), start(size_t(width)), share(size_t((borders + 1) * width)) {}

    // Not std::hypot, whose newest version needs a glibc of 2022.
    static double diagonal(double a, double b) { return std::sqrt(a * a + b * b); }

    int64_t buffer() const { return bins + 2 * margin + borders + 1; }

    void turn(T cosine, T sine) {
        T scale = T(bins) / T(width), a = std::abs(cosine), b = std::abs(sine);
        c = cosine, s = sine, longer = std::max(a, b) * scale, shorter = std::min(a, b) * scale;
        half_inverse = T(0.5) / std::max(shorter, T(1e-30)), inverse = 1 / longer;
    }

    // Overlap of a row of pixels: first border, then shares. Copies, because the arrays written might alias members.
    void cast(int64_t row) {
        const T scale = T(bins) / T(2 * width), l = longer, w = shorter, half = half_inverse, by = inverse;
        const T left = T(0.5) * T(bins) - (l + w) / 2 + T(height - 1 - 2 * row) * s * scale;
        const T first = T(1 - width) * c * scale + left, step = 2 * c * scale;
        const int32_t n = int32_t(width), shift = int32_t(margin) - 1;
        int32_t* __restrict begin = start.data();
        T* __restrict shares = share.data();
        const Borders count = borders;
        for (int32_t x = 0; x < n; ++x) {
            const T at = first + T(x) * step, edge = std::ceil(at);
            T before = 0;
            begin[x] = int32_t(edge) + shift;
            for (int32_t k = 0; k < count; ++k) {
                const T inside = edge - at + T(k);
                const T within = (ramp(inside, w, half) - ramp(inside - l, w, half)) * by;
                shares[k * n + x] = within - before;
                before = within;
            }
            shares[count * n + x] = 1 - before;
        }
    }

    SCALAR void scatter(T* __restrict bin, int64_t size, const T* __restrict line) const {
        const int32_t *__restrict begin = start.data(), n = int32_t(width);
        const T* __restrict shares = share.data();
        const Borders count = borders;
        for (int32_t x = 0; x < n; ++x) {
            T* place = bin + x % LANES * size + begin[x];
            for (int32_t k = 0; k <= count; ++k) place[k] += line[x] * shares[k * n + x];
        }
    }

    SCALAR void gather(const T* __restrict bin, T* __restrict line) const {
        const int32_t *__restrict begin = start.data(), n = int32_t(width);
        const T* __restrict shares = share.data();
        const Borders count = borders;
        for (int32_t x = 0; x < n; ++x) {
            const T* place = bin + begin[x];
            T total = 0;
            for (int32_t k = 0; k <= count; ++k) total += place[k] * shares[k * n + x];
            line[x] = total;
        }
    }
};

// Projection and back projection share all but the innermost loop.
template <class T, bool back, class Borders>
void project(T* image, const T* cosine, const T* sine, T* out, int64_t batch, int64_t channels, int64_t height,
          int64_t width, int64_t bins, Borders borders) {
    const T scale = T(bins) / (T(width) * T(width));
    Shadows<T, Borders> shadows(height, width, bins, borders);
    const int64_t size = shadows.buffer();
    std::vector<T> rows(size_t(channels * LANES * size));
    for (int64_t b = 0; b < batch; ++b) {
        T* measured = out + b * channels * bins;
        if (!std::isfinite(cosine[b]) || !std::isfinite(sine[b])) {  // no place in memory is that of such an angle
            T* found = back ? image + b * channels * height * width : measured;
            std::fill(found, found + channels * (back ? height * width : bins), std::numeric_limits<T>::quiet_NaN());
            continue;
        }
        shadows.turn(cosine[b], sine[b]);
        std::fill(rows.begin(), rows.end(), T(0));
        for (int64_t i = 0; back && i < channels * bins; ++i)
            rows[size_t(i / bins * LANES * size + shadows.margin + i % bins)] = measured[i] * scale;
        for (int64_t row = 0; row < height; ++row) {
            shadows.cast(row);
            for (int64_t c = 0; c < channels; ++c) {
                T* line = image + ((b * channels + c) * height + row) * width;
                T* bin = rows.data() + c * LANES * size;
                if constexpr (back) shadows.gather(bin, line);
                else shadows.scatter(bin, size, line);
            }
        }
        for (int64_t i = 0; !back && i < channels * bins; ++i) {
            const T* place = &rows[size_t(i / bins * LANES * size + shadows.margin + i % bins)];
            measured[i] = (place[0] + place[size] + place[2 * size] + place[3 * size]) * scale;
        }
    }
}

using TWO = std::integral_constant<int32_t, 2>;

}  // namespace

#define EXPORT(NAME, T, BACK)                                                                                     \
    extern "C" int NAME(T* image, const T* cosine, const T* sine, T* out, int64_t batch, int64_t channels,       \
                        int64_t height, int64_t width, int64_t bins) {                                            \
        const int32_t borders = int32_t(std::floor(std::sqrt(2.0) * double(bins) / double(width))) + 1;          \
        return status_of([=] {                                                                                    \
            if (borders == 2)                                                                                     \
                project<T, BACK>(image, cosine, sine, out, batch, channels, height, width, bins, TWO());         \
            else                                                                                                  \
                project<T, BACK>(image, cosine, sine, out, batch, channels, height, width, bins, borders);       \
        });                                                                                                       \
    }

EXPORT(project_float, float, false)
EXPORT(project_double, double, false)
EXPORT(project_back_float, float, true)
EXPORT(project_back_double, double, true)
