// What the C++ peers share: constants, the foam's law, contact, step size. SI units, tension
// positive; docs/model.md has the equations. Of a pair, [0] belongs to the bonds along x (A),
// [1] to those along y (B).
#pragma once

#include <algorithm>
#include <cmath>

#ifndef REAL
#define REAL double  // flops.cpp puts a number here that counts its operations
#endif

// What a scene's choices ask for; native.py compiles a library for each set of them.
#if !defined(RATE) || !defined(ROOM) || !defined(SOFTENING)
#error "native.py defines RATE, ROOM and SOFTENING as 0 or 1"
#endif

namespace peer {

using Real = REAL;
using std::abs;
using std::exp;
using std::max;
using std::min;
using std::pow;
using std::sqrt;

constexpr bool HAS_RATE = RATE;  // the plateau's stress grows with the strain rate
constexpr bool HAS_ROOM = ROOM;  // cells keep the room that their bonds have left them
constexpr bool SOFTENS = SOFTENING;  // beyond its limit a bond holds with ever less of its face

constexpr int A = 0, B = 1, LAST_STAGE = 3;
constexpr double INTACT = -1.0, NEVER = 1e30;  // break times of whole bonds, and of none
constexpr double BREAKING = -2.0;    // whole until the end of this step
constexpr double GUARD = 0.05;       // part of the way to locking where densification goes straight
constexpr double PACKED = 4.0;       // slope of packed foam against the floor, in Young's moduli
constexpr double HOLDS_TO = 2.0;     // a torn cell lets go between these diagonals, in cells
constexpr double FREE_FROM = 4.0;
constexpr double OPEN_AREA = 1.5;    // and at once by this area, over that at rest
constexpr double NEAR = 0.05;        // a cell with so much more area than it keeps may not press
constexpr double ROUNDING = 1e-9;    // what a cell may lack of its room without pressure
constexpr double RK4_RADIUS = 2.61;  // |h lambda| of the classical Runge-Kutta method
constexpr double RK4_DECAY = 2.785;  // the same on the real axis
constexpr double ASTRAY = 1e5;       // [m, m/s]: a node beyond has blown up

struct Vec {
    Real x, y;
};

inline Real dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y; }
inline Real cross(Vec a, Vec b) { return a.x * b.y - a.y * b.x; }
inline Real clamp(Real value, Real low, Real high) { return min(max(value, low), high); }

// In the order of constants.py, which fills it from a flat array. Of one lattice, or with a vector
// of numbers for each of several.
template <class Number>
struct ConstantsOf {
    Number youngs_modulus, shear_modulus, yield_strain, tensile_strain;
    Number shear_strength, pressure_coefficient;
    Number densification_strain, locking_strain, densification_a, densification_b;
    Number crushed_strain, crushed_stress;  // where crushed foam breaks in tension
    Number tensile_tail[2], shear_tail[2];  // how far a bond holds beyond its limit, over the limit
    Number rate;  // at which the plateau's stress has doubled [1/s]
    Number cell[2], per_length[2], area[2], thickness;
    Number dashpot[2];       // along a bond [N s/m]
    Number shear_viscosity;  // of a cell [Pa s]
    Number node_mass, gravity, hold_x, hold_y, floor_friction;
    Number contact_stiffness, contact_dashpot, support_stiffness;
    Number impactor_x, impactor_half_width, impactor_mass, impactor_friction;
    Number step, largest_step, safety;  // step 0: automatic
};

using Constants = ConstantsOf<Real>;
constexpr int CONSTANTS = sizeof(Constants) / sizeof(Real);

inline Constants constants_from(const double* values) {
    Constants c;
    Real* members = reinterpret_cast<Real*>(&c);
    for (int k = 0; k < CONSTANTS; ++k) members[k] = values[k];
    return c;
}

// An outward half-plane of the impactor's outline: a point p is behind it where n . p < offset.
struct Edge {
    Real nx, ny, offset;
};

struct Body {
    Real y, v, trial_y, trial_v, rate_y, rate_v;
};

// ---- the foam ----

// Foam that heeds the rate: its worst strain lags behind the strain, and flows after it at a rate
// in proportion to how far (Cowper & Symonds with the exponent 1). What is left of the lag after
// a step is this part of it.
inline Real lag_left(const Constants& c, Real step) {
    return exp(c.rate * step / c.yield_strain);
}

inline Real flowed_strain(const Constants& c, Real e, Real worst, Real left) {
    const Real start = min(max(e, c.yield_strain), worst);
    const Real lag = max(start - e, Real(0.0));
    return start - (lag - lag * left);
}

inline Real permanent_strain(const Constants& c, Real worst) {
    return clamp(worst, c.densification_strain, c.yield_strain) - c.yield_strain;
}

inline Real yielding_stress(const Constants& c, Real e, Real worst, bool broken) {
    const Real permanent = permanent_strain(c, worst);
    Real elastic = max(e - permanent, c.yield_strain);
    if (HAS_RATE) elastic += min(e - min(worst, c.yield_strain), Real(0.0));
    const Real stress = c.youngs_modulus * elastic;
    if (stress <= 0.0) return stress;
    if (broken) return 0.0;
    if (worst >= c.yield_strain) return stress;
    return c.crushed_stress / (c.crushed_strain - permanent) * (e - permanent);
}

struct Dense {
    Real stress, slope;
};

// What densification adds to the plateau, e < e_d, and the whole slope.
inline Dense densification(const Constants& c, Real e) {
    const Real guard = c.locking_strain + GUARD * (c.densification_strain - c.locking_strain);
    const Real inside = max(e, guard);
    const Real room = inside - c.locking_strain;
    const Real power = c.densification_b == 1.0 ? room : pow(room, c.densification_b);
    const Real steepness = c.densification_a / power;
    const Real exponent = steepness * (c.densification_strain - inside);
    const Real plateau = c.youngs_modulus * c.yield_strain;
    const Real stress = plateau * exp(exponent);
    const Real slope = -stress * (steepness + c.densification_b * exponent / room);
    return {stress + slope * (e - inside) - plateau, slope};
}

inline Real tensile_limit(const Constants& c, Real worst) {
    return worst < c.yield_strain ? c.crushed_strain : c.tensile_strain;
}

// The shear strength grows with the stress up to the plateau.
inline bool fails_in_shear(const Constants& c, Real e, Real stress, Real tau) {
    Real strength = c.shear_strength;
    if (e < 0.0) strength += c.pressure_coefficient * abs(stress);
    return abs(tau) > strength;
}

// What a cell with a broken side still holds of its forces, by its diagonals.
inline Real hold_left(const Constants& c, Vec d1, Vec d2, Real before) {
    const Real across = c.cell[0] * c.cell[0] + c.cell[1] * c.cell[1];
    const Real size = sqrt(2.0 * max(dot(d1, d1), dot(d2, d2)) / across);
    if (cross(d1, d2) > 2.0 * OPEN_AREA * c.cell[0] * c.cell[1]) return 0.0;
    return clamp((FREE_FROM - size) / (FREE_FROM - HOLDS_TO), 0.0, before);
}

// ---- contact ----

struct Touch {
    Vec pressing, rubbing;
    Real distance, stretch;  // of the friction spring
};

inline Real tangential_force(Real stiffness, Real stretch, Real limit) {
    return -clamp(stiffness * stretch, -limit, limit);
}

// The impactor's force on a node at `point` from its lowest point, of a relative velocity. `path`
// is how far the node has moved against the impactor since its friction spring was `stretch` long.
inline Touch impactor_contact(const Constants& c, const Edge* edges, int edge_count, Vec point,
                              Vec relative, Vec path, Real stretch) {
    Touch touch = {{0.0, 0.0}, {0.0, 0.0}, 1.0, 0.0};
    if (!(point.y > 0.0 && abs(point.x) < c.impactor_half_width)) return touch;
    Vec normal = {0.0, -1.0};
    touch.distance = -NEVER;
    for (int k = 0; k < edge_count; ++k) {
        const Real distance = edges[k].nx * point.x + edges[k].ny * point.y - edges[k].offset;
        if (distance > touch.distance) {
            touch.distance = distance;
            normal = {edges[k].nx, edges[k].ny};
        }
    }
    if (touch.distance >= 0.0) return touch;
    const Vec tangent = {-normal.y, normal.x};
    const Real spring = -c.contact_stiffness * touch.distance;
    const Real force = max(spring - c.contact_dashpot * dot(relative, normal), Real(0.0));
    const Real along = tangential_force(c.contact_stiffness, stretch + dot(path, tangent),
                                        c.impactor_friction * force);
    touch.pressing = {force * normal.x, force * normal.y};
    touch.rubbing = {along * tangent.x, along * tangent.y};
    touch.stretch = -along / c.contact_stiffness;
    return touch;
}

// The floor's force on a node at height `y`: half a cell of foam lies between, or what the worst
// crush of the node's bonds has left of it.
inline Touch floor_contact(const Constants& c, Real y, Real worst_a, Real worst_b, Real path,
                           Real stretch) {
    Touch touch = {{0.0, 0.0}, {0.0, 0.0}, 1.0, 0.0};
    const Real half = 0.5 * c.cell[1];
    const Real radius = 0.5 * min(c.cell[0] * (1.0 + worst_a), c.cell[1] * (1.0 + worst_b));
    if (y >= half) return touch;
    if (y < radius) {
        const Real packed = min(y - (1.0 + c.densification_strain) * radius, Real(0.0)) / half;
        const Real strain = max((y - radius) / half, c.yield_strain);
        touch.pressing.y = -c.area[1] * c.youngs_modulus * (strain + PACKED * packed);
    }
    const Real limit = c.floor_friction * touch.pressing.y;
    touch.rubbing.x = tangential_force(c.contact_stiffness, stretch + path, limit);
    touch.stretch = -touch.rubbing.x / c.contact_stiffness;
    return touch;
}

// ---- time ----

// The largest stable step while the stiffest densified bond has `densified` [N/m].
inline Real stable_step(const Constants& c, Real densified) {
    const Real aspect = max(c.area[0] * c.per_length[0], c.area[1] * c.per_length[1]);
    const Real modulus = max(c.youngs_modulus, c.crushed_stress / c.crushed_strain);
    const Real elastic = modulus * aspect;
    // with a rate, the overstress comes on top
    const Real stiffest = HAS_RATE ? elastic + densified : max(elastic, densified);
    Real stiffness = 4.0 * stiffest + 4.0 * c.shear_modulus * aspect + c.contact_stiffness;
    if (HAS_ROOM) {
        const Real ratio = max(c.cell[0], c.cell[1]) / min(c.cell[0], c.cell[1]);
        stiffness += 4.0 * ratio * PACKED * c.youngs_modulus * c.thickness;
    }
    const Real decay = 4.0 * (c.dashpot[0] + c.dashpot[1] + c.shear_viscosity * aspect);
    const Real rate = max(sqrt(stiffness / c.node_mass),
                          decay / c.node_mass * (RK4_RADIUS / RK4_DECAY));
    return min(c.safety * RK4_RADIUS / rate, c.largest_step);
}

// A stage's share of the step in the weighted sum, and how far ahead the next stage looks.
template <class Number>
Number stage_weight(int stage, Number step) {
    return step / (stage == 0 || stage == LAST_STAGE ? 6.0 : 3.0);
}
template <class Number>
Number stage_ahead(int stage, Number step) {
    return stage < 2 ? 0.5 * step : step;
}

// The impactor's stage, given the nodes' force on it.
inline void body_stage(const Constants& c, Body& body, int stage, Real step, Real lift) {
    const Real weight = stage_weight(stage, step), ahead = stage_ahead(stage, step);
    // the support stops the impactor once it has gone right through the block
    const Real force = lift + c.support_stiffness * max(-body.trial_y, Real(0.0));
    const Real acceleration = force / c.impactor_mass - c.gravity;
    const Real rate_y = weight * body.trial_v + (stage > 0 ? body.rate_y : Real(0.0));
    const Real rate_v = weight * acceleration + (stage > 0 ? body.rate_v : Real(0.0));
    const Real speed = body.trial_v;
    if (stage < LAST_STAGE) {
        body.trial_y = body.y + ahead * speed;
        body.trial_v = body.v + ahead * acceleration;
    } else {
        body.y = body.trial_y = body.y + rate_y;
        body.v = body.trial_v = body.v + rate_v;
    }
    body.rate_y = rate_y;
    body.rate_v = rate_v;
}

// Do `part(i)` for all columns, spread over threads.
template <class Part>
void over_columns(int columns, int threads, Part part) {
    if (threads == 1) {
        for (int i = 0; i < columns; ++i) part(i);
        return;
    }
#pragma omp parallel for num_threads(threads) schedule(static)
    for (int i = 0; i < columns; ++i) part(i);
}

}  // namespace peer
