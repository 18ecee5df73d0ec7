// A vector of doubles as wide as the processor's, by the compiler's own vector type (GCC, Clang):
// arithmetic, comparison and `?:` then act lane by lane, and nothing hangs on a loop's being
// vectorised.
#pragma once

#include <cmath>
#ifdef __AVX__
#include <immintrin.h>
#endif

namespace peer {

#if defined(__AVX512F__)
constexpr int WIDTH = 8;
#elif defined(__AVX__)
constexpr int WIDTH = 4;
#else
constexpr int WIDTH = 2;
#endif

constexpr int BYTES = WIDTH * sizeof(double);
typedef double Lanes __attribute__((vector_size(BYTES)));
typedef double Unaligned __attribute__((vector_size(BYTES), aligned(8), may_alias));

inline Lanes load(const double* from) { return *reinterpret_cast<const Unaligned*>(from); }
inline void store(double* to, Lanes value) { *reinterpret_cast<Unaligned*>(to) = value; }

inline Lanes all(double value) { return Lanes{} + value; }
inline Lanes least(Lanes a, Lanes b) { return a < b ? a : b; }
inline Lanes most(Lanes a, Lanes b) { return a > b ? a : b; }
inline Lanes magnitude(Lanes a) { return a < 0.0 ? -a : a; }

inline Lanes root(Lanes a) {
#if defined(__AVX512F__)
    return Lanes(_mm512_sqrt_pd(__m512d(a)));
#elif defined(__AVX__)
    return Lanes(_mm256_sqrt_pd(__m256d(a)));
#else
    for (int k = 0; k < WIDTH; ++k) a[k] = std::sqrt(a[k]);
    return a;
#endif
}

inline double sum(Lanes a) {
    double total = 0.0;
    for (int k = 0; k < WIDTH; ++k) total += a[k];
    return total;
}

inline double least_of(Lanes a) {
    double found = a[0];
    for (int k = 1; k < WIDTH; ++k) found = a[k] < found ? a[k] : found;
    return found;
}

}  // namespace peer
