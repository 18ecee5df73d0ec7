// The C interface that native.py calls, the same for each C++ peer's lattice.
#pragma once

namespace peer {

// Works [J] that the lattice adds up in the same Runge-Kutta sum as the motion.
enum { BONDS, SHEAR, DASHPOTS, CONTACT, FRICTION, PRESSING, WORKS };

}  // namespace peer

#define PEER_INTERFACE(Lattice)                                                                  \
    extern "C" {                                                                                 \
    int constants_count() { return peer::CONSTANTS; }                                            \
    int summary_count() { return 5 + peer::WORKS; }                                              \
    void* create(int columns, int rows, const double* constants, int edge_count,                 \
                 const double* edges, const double* start, const double* body) {                 \
        return new Lattice(columns, rows, constants, edge_count, edges, start, body);            \
    }                                                                                            \
    void destroy(void* lattice) { delete static_cast<Lattice*>(lattice); }                       \
    long advance(void* lattice, long steps, int threads) {                                       \
        return static_cast<Lattice*>(lattice)->advance(steps, threads);                          \
    }                                                                                            \
    void read(void* lattice, double* nodes, double* summary) {                                   \
        static_cast<Lattice*>(lattice)->read(nodes, summary);                                    \
    }                                                                                            \
    }
