// A vector of doubles as wide as the processor's, by the compiler's own vector type (GCC, Clang):
// arithmetic, comparison and `?:` then act lane by lane, and nothing hangs on a loop's being
// vectorised.
#pragma once

#include <cmath>
#ifdef __AVX__
#include <immintrin.h>
#endif

namespace peer {

// BITS, if native.py defines it, is the widest vector that is wanted.
#if !defined(BITS)
#define BITS 512
#endif
#if defined(__AVX512F__) && BITS >= 512
#define HAS_512 1
constexpr int WIDTH = 8;
#elif defined(__AVX__) && BITS >= 256
#define HAS_256 1
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
#if defined(HAS_512)
    return Lanes(_mm512_sqrt_pd(__m512d(a)));
#elif defined(HAS_256)
    return Lanes(_mm256_sqrt_pd(__m256d(a)));
#else
    for (int k = 0; k < WIDTH; ++k) a[k] = std::sqrt(a[k]);
    return a;
#endif
}

// Whether `a` is below `b` in any lane.
inline bool any_below(Lanes a, Lanes b) {
#if defined(HAS_512)
    return _mm512_cmp_pd_mask(__m512d(a), __m512d(b), _CMP_LT_OQ) != 0;
#elif defined(HAS_256)
    return _mm256_movemask_pd(_mm256_cmp_pd(__m256d(a), __m256d(b), _CMP_LT_OQ)) != 0;
#else
    bool found = false;
    for (int k = 0; k < WIDTH; ++k) found |= a[k] < b[k];
    return found;
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
