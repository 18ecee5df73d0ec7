// plain.cpp with a number that counts what is done to it.
#include <cmath>
#include <vector>

namespace peer {

struct Counts {
    long adds, multiplies, divides, roots, compares, others;
};
Counts counts = {};

struct Counted {
    double value;
    Counted() = default;
    Counted(double value) : value(value) {}
    explicit operator double() const { return value; }
    Counted& operator+=(Counted b) { return ++counts.adds, value += b.value, *this; }
    Counted& operator-=(Counted b) { return ++counts.adds, value -= b.value, *this; }
};

inline Counted operator-(Counted a) { return -a.value; }  // a sign's flip is no operation
inline Counted operator+(Counted a, Counted b) { return ++counts.adds, a.value + b.value; }
inline Counted operator-(Counted a, Counted b) { return ++counts.adds, a.value - b.value; }
inline Counted operator*(Counted a, Counted b) { return ++counts.multiplies, a.value * b.value; }
inline Counted operator/(Counted a, Counted b) { return ++counts.divides, a.value / b.value; }
inline bool operator<(Counted a, Counted b) { return ++counts.compares, a.value < b.value; }
inline bool operator>(Counted a, Counted b) { return ++counts.compares, a.value > b.value; }
inline bool operator<=(Counted a, Counted b) { return ++counts.compares, a.value <= b.value; }
inline bool operator>=(Counted a, Counted b) { return ++counts.compares, a.value >= b.value; }
inline bool operator==(Counted a, Counted b) { return ++counts.compares, a.value == b.value; }
inline bool operator!=(Counted a, Counted b) { return ++counts.compares, a.value != b.value; }
inline Counted sqrt(Counted a) { return ++counts.roots, std::sqrt(a.value); }
inline Counted abs(Counted a) { return std::abs(a.value); }
inline Counted exp(Counted a) { return ++counts.others, std::exp(a.value); }
inline Counted pow(Counted a, Counted b) { return ++counts.others, std::pow(a.value, b.value); }

}  // namespace peer

#define REAL ::peer::Counted
#include "plain.cpp"

extern "C" void read_counts(long* to) {
    const peer::Counts& c = peer::counts;
    const long values[] = {c.adds, c.multiplies, c.divides, c.roots, c.compares, c.others};
    for (int k = 0; k < 6; ++k) to[k] = values[k];
    peer::counts = {};
}
