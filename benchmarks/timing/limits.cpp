// What this machine's memory and arithmetic can do: `limits THREADS` prints bytes and operations
// per second, each the best of a few passes.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>

#if defined(__AVX512F__)
constexpr int BYTES = 64;
#elif defined(__AVX__)
constexpr int BYTES = 32;
#else
constexpr int BYTES = 16;
#endif

typedef double Lanes __attribute__((vector_size(BYTES)));

constexpr long LENGTH = 1L << 24;  // of each array: 128 MiB, beyond any cache of a small machine
constexpr int PASSES = 5, CHAINS = 12;  // enough to hide a multiplication's latency
constexpr long TURNS = 1L << 22;

template <class Work>
double best(Work work) {
    double least = 1e30;
    for (int pass = 0; pass < PASSES; ++pass) {
        const auto start = std::chrono::steady_clock::now();
        work();
        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
        least = std::min(least, took.count());
    }
    return least;
}

int main(int count, char** arguments) {
    const int threads = count > 1 ? std::atoi(arguments[1]) : 1;
    double* a = static_cast<double*>(std::malloc(LENGTH * sizeof(double)));
    double* b = static_cast<double*>(std::malloc(LENGTH * sizeof(double)));
    double* c = static_cast<double*>(std::malloc(LENGTH * sizeof(double)));
#pragma omp parallel for num_threads(threads) schedule(static)
    for (long k = 0; k < LENGTH; ++k) a[k] = 0.0, b[k] = 1.0, c[k] = 2.0;

    const double triad = best([&] {
#pragma omp parallel for num_threads(threads) schedule(static)
        for (long k = 0; k < LENGTH; ++k) a[k] = b[k] + 3.0 * c[k];
    });
    double sink = 0.0;
    const double fused = best([&] {
#pragma omp parallel for num_threads(threads) schedule(static) reduction(+ : sink)
        for (int thread = 0; thread < threads; ++thread) {
            Lanes chain[CHAINS], factor, step;
            for (int k = 0; k < BYTES / 8; ++k) {
                factor[k] = 0.999 + 1e-6 * thread;
                step[k] = 1e-3;
                for (int n = 0; n < CHAINS; ++n) chain[n][k] = n + k;
            }
            for (long turn = 0; turn < TURNS; ++turn)
                for (int n = 0; n < CHAINS; ++n) chain[n] = chain[n] * factor + step;
            for (int n = 0; n < CHAINS; ++n) sink += chain[n][0];
        }
    });
    // a write first fetches its line: four numbers move for every element
    const double bytes = 4.0 * sizeof(double) * LENGTH;
    const double operations = 2.0 * (BYTES / 8) * CHAINS * double(TURNS) * threads;
    std::printf("%.6g %.6g %g\n", bytes / triad, operations / fused, a[LENGTH / 2] + sink > 0.0);
    return 0;
}
