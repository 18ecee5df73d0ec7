// The same step with a lattice in each lane: a vector holds one number of as many lattices, and
// what is next to a node is never in another lane. What lanes do at different times (densification,
// contact, room, softening) is done for all of them where any needs it.
//
// A strip is what lies between two columns of nodes. It is gone through once, from the base up: the
// nodes on its left then have all their forces, and move. A node and what it needs of its bonds and
// cell lie side by side in memory.
#include <cstdlib>
#include <memory>
#include <vector>

#include "interface.hpp"
#include "lanes.hpp"
#include "model.hpp"

namespace peer {

using Pack = ConstantsOf<Lanes>;

template <class Record>
class Array {
  public:
    explicit Array(int size)
        : data(static_cast<Record*>(std::aligned_alloc(BYTES, size * sizeof(Record)))) {
        std::fill(data.get(), data.get() + size, Record{});
    }
    Record& operator[](int k) const { return data.get()[k]; }

  private:
    struct Free {
        void operator()(Record* memory) const { std::free(memory); }
    };
    std::unique_ptr<Record[], Free> data;
};

struct Motion {
    Lanes x, y, vx, vy;
};

struct Bond {
    Lanes worst;
    Lanes opening;  // slope of what pulls, by the worst strain [Pa]
    Lanes intact;   // part of its face that pulls; 0 of a broken one
};

struct Links {  // a node's bonds to the right and above, and the cell between
    Bond bond[2];
    Lanes grip;  // what the cell carries of its shear
};

struct Rare {  // of a node and its cell
    Lanes hold = all(1.0);  // what the cell holds of its forces
    Lanes impactor_slip = {}, floor_slip = {};  // stretch of the friction springs [m]
    bool slips = false;    // one of them may be stretched
    bool worn = false;     // one of the cell's bonds has lost a part of its face
    bool presses = false;  // the cell may have less area than room in this step
};

struct Loss {  // what is left of a node's bond from the end of this step on
    int node, axis;
    Lanes left;
};

struct Push {
    Lanes x, y;
};

struct Face {  // of the cells of a column: their columns along x, and which cells count
    Lanes x, y, counts;
};

struct Factors {  // that every node needs, by the constants
    Lanes elasticity, viscosity;  // of a cell, over its squares [N/m3, N s/m3]
    Lanes tau;                    // shear modulus over a cell's sides [Pa/m2]
    Lanes per_mass, beside;       // 1 / mass, and half of a cell's height
    Lanes weight, ahead;          // of this stage [s]
};

struct LanesEdge {
    Lanes nx, ny, offset;
};

struct LanesBody {
    Lanes y, v, trial_y, trial_v, rate_y, rate_v;
};

inline Lanes bounded(Lanes value, Lanes low, Lanes high) {
    return least(most(value, low), high);
}

// e^x for x from -700 to 700, by Taylor's series around the next multiple of ln 2.
inline Lanes power_of_e(Lanes x) {
    typedef long long Whole __attribute__((vector_size(BYTES)));
    x = bounded(x, all(-700.0), all(700.0));
    const Lanes magic = all(6755399441055744.0);  // 1.5 * 2^52: its last bits count ones
    const Lanes shifted = x * 1.4426950408889634 + magic, n = shifted - magic;
    const Lanes r = (x - n * 0.6931471803691238) - n * 1.9082149292705877e-10;
    Lanes series = {};
    double part = 1.0 / 6227020800.0;  // of 13!
    for (int k = 13; k > 0; part *= k--) series = (series + part) * r;
    const Whole exponent = (reinterpret_cast<Whole>(shifted) << 52) + (1023LL << 52);
    return (series + 1.0) * reinterpret_cast<Lanes>(exponent);
}

// As many lattices as there are lanes, all on one thread.
class Lattices {
  public:
    Lattices(int columns, int rows, const double* const* constants, int edge_count,
             const double* const* edges, const double* const* starts, const double* const* bodies)
        : columns(columns), rows(rows), state(columns * rows), trial(columns * rows),
          rate(columns * rows), links(columns * rows), rare(columns * rows), left(rows),
          behind(rows), edges(edge_count), body{}, time{}, step{}, lift{}, densified{}, astray{},
          power{}, work{} {
        for (int lane = 0; lane < WIDTH; ++lane) {
            of_lane[lane] = constants_from(constants[lane]);
            for (int k = 0; k < CONSTANTS; ++k)
                reinterpret_cast<Lanes*>(&c)[k][lane] = constants[lane][k];
            for (int k = 0; k < edge_count; ++k) {
                this->edges[k].nx[lane] = edges[lane][3 * k];
                this->edges[k].ny[lane] = edges[lane][3 * k + 1];
                this->edges[k].offset[lane] = edges[lane][3 * k + 2];
            }
            for (int k = 0; k < columns * rows; ++k)
                for (int m = 0; m < 4; ++m)
                    reinterpret_cast<Lanes*>(&state[k])[m][lane] = starts[lane][4 * k + m];
            body.y[lane] = body.trial_y[lane] = bodies[lane][0];
            body.v[lane] = body.trial_v[lane] = bodies[lane][1];
        }
        // thickness times stress, halved, is a force over a diagonal's length
        const Lanes per_area = c.per_length[A] * c.per_length[B];
        f.elasticity = 0.125 * c.thickness * c.shear_modulus * per_area;
        f.viscosity = 0.25 * c.thickness * c.shear_viscosity * per_area;
        f.tau = c.shear_modulus * per_area;
        f.per_mass = 1.0 / c.node_mass;
        f.beside = 0.5 * c.cell[B];
        for (int i = 0; i < columns; ++i)
            for (int j = 0; j < rows; ++j) {
                Links& mine = links[at(i, j)];
                for (Bond& bond : mine.bond) bond.opening = c.youngs_modulus;
                const bool right = i < columns - 1, above = j < rows - 1;
                mine.bond[A].intact = all(right);
                mine.bond[B].intact = all(above);
                mine.grip = all(right && above);
            }
    }

    void advance(long steps) {
        for (long n = 0; n < steps; ++n) {
            for (int lane = 0; lane < WIDTH; ++lane)
                step[lane] = of_lane[lane].step > 0.0 ? of_lane[lane].step
                                                      : stable_step(of_lane[lane], densified[lane]);
            run_stage<0>();
            run_stage<1>();
            run_stage<2>();
            run_stage<LAST_STAGE>();
            time += step;
            take_losses();
            if (any_below(Lanes{}, astray)) return;
        }
    }

    void read(int lane, double* nodes, double* summary) const {
        for (int k = 0; k < columns * rows; ++k)
            for (int m = 0; m < 4; ++m)
                nodes[4 * k + m] = reinterpret_cast<const Lanes*>(&state[k])[m][lane];
        summary[0] = time[lane];
        summary[1] = step[lane];
        summary[2] = body.y[lane];
        summary[3] = body.v[lane];
        summary[4] = broken[lane];
        for (int k = 0; k < WORKS; ++k) summary[5 + k] = work[k][lane];
    }

  private:
    int columns, rows;
    Constants of_lane[WIDTH];
    Pack c;
    Factors f;
    Array<Motion> state, trial, rate;
    Array<Links> links;
    Array<Rare> rare;
    Array<Push> left;    // by row: what the strip to the left does to its right nodes [N]
    Array<Face> behind;  // by row: of the cells of that strip
    std::vector<LanesEdge> edges;
    LanesBody body;
    Lanes time, step;
    Lanes lift, densified, astray;  // of a stage, of all columns so far
    Lanes power[WORKS], work[WORKS];
    std::vector<Loss> losses;
    int broken[WIDTH] = {};

    int at(int i, int j) const { return i * rows + j; }

    // What the rows of a strip hand up.
    struct Climb {
        Push to_here, to_right;  // on the nodes of the next row [N]
        Face below;  // the cell under them, with its column along y
        Lanes taken, sheared, damped;  // powers so far [W]
    };

    template <int stage>
    void run_stage() {
        f.weight = stage_weight(stage, step), f.ahead = stage_ahead(stage, step);
        lift = densified = Lanes{};
        for (Lanes& each : power) each = Lanes{};
        for (int j = 0; j < rows; ++j) left[j] = Push{}, behind[j] = Face{};
        for (int i = 0; i < columns - 1; ++i) strip<stage, false>(i);
        strip<stage, true>(columns - 1);
        const Lanes weight = f.weight, ahead = f.ahead;
        for (int k = 0; k < WORKS; ++k) work[k] += weight * power[k];
        // the support stops the impactor once it has gone right through the block
        const Lanes force = lift + c.support_stiffness * most(-body.trial_y, Lanes{});
        const Lanes acceleration = force / c.impactor_mass - c.gravity;
        body.rate_y = weight * body.trial_v + (stage > 0 ? body.rate_y : Lanes{});
        body.rate_v = weight * acceleration + (stage > 0 ? body.rate_v : Lanes{});
        if (stage < LAST_STAGE) {
            body.trial_y = body.y + ahead * body.trial_v;
            body.trial_v = body.v + ahead * acceleration;
        } else {
            body.y = body.trial_y = body.y + body.rate_y;
            body.v = body.trial_v = body.v + body.rate_v;
        }
    }

    template <int stage, bool last_column>
    void strip(int i) {
        const Array<Motion>& now = stage == 0 ? state : trial;
        Climb climb = {};
        for (int j = 0; j < rows - 1; ++j) row<stage, last_column, false>(now, i, j, climb);
        row<stage, last_column, true>(now, i, rows - 1, climb);
        power[BONDS] += climb.taken;
        power[SHEAR] += climb.sheared;
        power[DASHPOTS] += climb.damped;
    }

    // The bonds of node (i, j), the cell between them, and its stage.
    template <int stage, bool last_column, bool last_row>
    __attribute__((always_inline)) void row(const Array<Motion>& now, int i, int j, Climb& climb) {
        constexpr bool has_cell = !last_column && !last_row;
        const int k = at(i, j);
        Links& mine = links[k];
        // where there is no such node it is not used
        const Motion &here = now[k], &right = now[last_column ? k : k + rows];
        const Motion &up = now[last_row ? k : k + 1], &far = now[has_cell ? k + rows + 1 : k];
        Push on_here = {left[j].x + climb.to_here.x, left[j].y + climb.to_here.y};
        Push on_right = climb.to_right, on_up = {}, on_far = {};
        Face along_x = {}, along_y = {};  // the cell's columns
        if (has_cell) {
            const Lanes d1x = far.x - here.x, d1y = far.y - here.y;
            const Lanes d2x = up.x - right.x, d2y = up.y - right.y;
            if (stage == 0) look_at_cell(k, d1x, d1y, d2x, d2y);
            const Lanes d1u = far.vx - here.vx, d1v = far.vy - here.vy;
            const Lanes d2u = up.vx - right.vx, d2v = up.vy - right.vy;
            const Lanes squares = (d1x * d1x + d1y * d1y) - (d2x * d2x + d2y * d2y);
            const Lanes closing = (d1x * d1u + d1y * d1v) - (d2x * d2u + d2y * d2v);
            const Lanes grip = mine.grip;
            const Lanes elastic = grip * (f.elasticity * squares);
            const Lanes viscous = grip * (f.viscosity * closing);
            climb.sheared += elastic * closing;
            climb.damped += viscous * closing;
            const Lanes pull = elastic + viscous;
            Push first = {pull * d1x, pull * d1y}, second = {pull * d2x, pull * d2y};
            if (HAS_ROOM && rare[k].presses) {
                const Lanes half = press(k, here, right, up, far);
                power[PRESSING] -=
                    half * ((d2y * d1u - d2x * d1v) + (d1x * d2v - d1y * d2u));
                first.x -= half * d2y;
                first.y += half * d2x;
                second.x -= half * d1y;
                second.y += half * d1x;
            }
            on_here.x += first.x, on_here.y += first.y;
            on_far = {-first.x, -first.y};
            on_up = {second.x, second.y};
            on_right.x -= second.x, on_right.y -= second.y;
            if (stage == LAST_STAGE) {
                const Lanes counts = grip > Lanes{} ? all(1.0) : Lanes{};
                along_x = {counts * (d1x - d2x), counts * (d1y - d2y), counts};
                along_y = {counts * (d1x + d2x), counts * (d1y + d2y), counts};
            }
        }
        if (!last_column) {
            const Push pull = bond<A, stage>(k, mine.bond[A], here, right, along_y, climb.below,
                                             climb.damped);
            on_here.x += pull.x, on_here.y += pull.y;
            on_right.x -= pull.x, on_right.y -= pull.y;
        }
        if (!last_row) {
            const Push pull = bond<B, stage>(k, mine.bond[B], here, up, along_x, behind[j],
                                             climb.damped);
            on_here.x += pull.x, on_here.y += pull.y;
            on_up.x -= pull.x, on_up.y -= pull.y;
        }
        left[j] = on_right;
        if (stage == LAST_STAGE) behind[j] = along_x;
        climb.to_here = on_up, climb.to_right = on_far;
        if (stage == LAST_STAGE) climb.below = along_y;
        climb.taken -= on_here.x * here.vx + on_here.y * here.vy;
        move<stage>(i, j, k, here, on_here);
    }

    // Force of a bond on its first node. The first stage brings the worst strain up to date, the
    // last finds what fails, by the shear of the cells on both sides.
    template <int axis, int stage>
    __attribute__((always_inline)) Push bond(int k, Bond& mine, const Motion& from,
                                             const Motion& to, const Face& ahead,
                                             const Face& behind, Lanes& damped) {
        const Lanes zero = {}, one = all(1.0);
        const Lanes rx = to.x - from.x, ry = to.y - from.y;
        const Lanes length = root(rx * rx + ry * ry), per_reach = one / length;
        const Lanes e = length * c.per_length[axis] - 1.0;
        const Lanes worst = mine.worst, intact = mine.intact;
        Lanes opening = mine.opening;
        const Lanes rest = bounded(worst, c.densification_strain, c.yield_strain) - c.yield_strain;
        const Lanes elastic = e - rest;
        const Lanes closed = c.youngs_modulus * least(most(elastic, c.yield_strain), zero);
        Lanes opened = most(elastic, zero) * opening;
        const Lanes rate =
            (rx * (to.vx - from.vx) + ry * (to.vy - from.vy)) * per_reach;
        const Lanes drag = intact * c.dashpot[axis] * rate;
        damped += drag * rate;
        Lanes stress = closed + intact * opened;
        if (any_below(e, c.densification_strain))
            stress += densify<stage>(e, c.area[axis] * c.per_length[axis]);
        const Lanes pull = (c.area[axis] * stress + drag) * per_reach;
        if (stage == 0 && any_below(e, worst)) {
            const Lanes deeper = least(worst, e);
            const Lanes set =
                bounded(deeper, c.densification_strain, c.yield_strain) - c.yield_strain;
            mine.worst = deeper;
            mine.opening = deeper < c.yield_strain ? c.crushed_stress / (c.crushed_strain - set)
                                                   : c.youngs_modulus;
        }
        if (stage == LAST_STAGE) {
            const Lanes met = least(worst, e);
            const Lanes limit = met < c.yield_strain ? c.crushed_strain : c.tensile_strain;
            const Lanes differences = 2.0 * most(ahead.counts + behind.counts, one);
            const Lanes across = rx * (ahead.x + behind.x) + ry * (ahead.y + behind.y);
            const Lanes tau = magnitude(f.tau * across / differences);
            const Lanes pressure = e < zero ? magnitude(closed + opened) : zero;
            const Lanes strength = c.shear_strength + c.pressure_coefficient * pressure;
            const Lanes beyond = most(e - limit, tau - strength);
            if (any_below(zero, intact > zero ? beyond : zero))
                lose<axis>(k, intact, e / limit, tau / strength);
        }
        return {pull * rx, pull * ry};
    }

    // What densification adds to the stress, of a constant b of 1: native.py refuses others.
    template <int stage>
    __attribute__((noinline)) Lanes densify(Lanes e, Lanes area_per_length) {
        const Lanes dense = c.densification_strain, locking = c.locking_strain;
        const Lanes inside = most(least(e, dense), locking + GUARD * (dense - locking));
        const Lanes room = inside - locking, steepness = c.densification_a / room;
        const Lanes exponent = steepness * (dense - inside);
        const Lanes plateau = c.youngs_modulus * c.yield_strain;
        const Lanes stress = plateau * power_of_e(exponent);
        const Lanes slope = -stress * (steepness + exponent / room);
        const auto acts = e < dense;
        densified = acts ? most(densified, slope * area_per_length) : densified;
        return acts ? stress + slope * (e - inside) - plateau : Lanes{};
    }

    // Beyond its limit a bond holds ever less, or it breaks at once.
    template <int axis>
    __attribute__((noinline)) void lose(int k, Lanes intact, Lanes pulled, Lanes sheared) {
        const Lanes one = all(1.0), none = {};
        Lanes holds = none;
        if (SOFTENS) {
            const auto held = [&](Lanes overload, Lanes tail) {
                const Lanes fallen =
                    (tail - overload) / (overload * most(tail - 1.0, all(1e-9)));
                return overload > one ? most(fallen, none) : one;
            };
            holds = least(held(pulled, c.tensile_tail[axis]), held(sheared, c.shear_tail[axis]));
        } else {
            holds = most(pulled, sheared) > one ? none : one;
        }
        holds = least(holds, intact);
        for (int lane = 0; lane < WIDTH; ++lane) holds[lane] = float(holds[lane]);
        if (any_below(holds, intact)) losses.push_back({k, axis, holds});
    }

    // Between two steps: bonds lose what they no longer hold.
    void take_losses() {
        for (const Loss& loss : losses) {
            Lanes& intact = links[loss.node].bond[loss.axis].intact;
            for (int lane = 0; lane < WIDTH; ++lane)
                broken[lane] += intact[lane] > 0.0 && loss.left[lane] == 0.0;
            intact = loss.left;
            const int side = loss.axis == A ? 1 : rows;
            rare[loss.node].worn = true;
            if (loss.node >= side) rare[loss.node - side].worn = true;
        }
        losses.clear();
    }

    // Before a step: a cell lets go as cracks pull it apart, and may press if it has hardly more
    // area than room.
    __attribute__((always_inline)) void look_at_cell(int k, Lanes d1x, Lanes d1y, Lanes d2x,
                                                     Lanes d2y) {
        const Links &mine = links[k], &above = links[k + 1], &right = links[k + rows];
        Rare& own = rare[k];
        if (own.worn) let_go(k, d1x, d1y, d2x, d2y);
        if (!HAS_ROOM) return;
        const Lanes now = area(d1x, d1y, d2x, d2y) - NEAR;
        own.presses = any_below(now, 1.0 + c.densification_strain);
        if (!own.presses) return;
        const Lanes along_x = mine.bond[A].worst + above.bond[A].worst;
        const Lanes along_y = mine.bond[B].worst + right.bond[B].worst;
        const Lanes room = (1.0 + 0.5 * along_x) * (1.0 + 0.5 * along_y);
        own.presses = any_below(Lanes{}, room_stress(now, room));
    }

    __attribute__((noinline)) void let_go(int k, Lanes d1x, Lanes d1y, Lanes d2x, Lanes d2y) {
        const Lanes zero = {}, one = all(1.0);
        const Lanes a = links[k].bond[A].intact, b = links[k].bond[B].intact;
        const Lanes above = links[k + 1].bond[A].intact, right = links[k + rows].bond[B].intact;
        const Lanes weakest = least(least(a, above), least(b, right));
        const Lanes across = c.cell[A] * c.cell[A] + c.cell[B] * c.cell[B];
        const Lanes longer = most(d1x * d1x + d1y * d1y, d2x * d2x + d2y * d2y);
        Lanes holds = (FREE_FROM - root(2.0 * longer / across)) / (FREE_FROM - HOLDS_TO);
        holds = area(d1x, d1y, d2x, d2y) > all(OPEN_AREA) ? zero : holds;
        Lanes& hold = rare[k].hold;
        hold = weakest == zero ? bounded(holds, zero, hold) : hold;
        // it hangs together by one of its two sides along each axis
        links[k].grip = weakest < one ? hold * most(a, above) * most(b, right) : links[k].grip;
    }

    // Signed, over that at rest.
    Lanes area(Lanes d1x, Lanes d1y, Lanes d2x, Lanes d2y) const {
        return (d1x * d2y - d1y * d2x) * (0.5 * c.per_length[A] * c.per_length[B]);
    }

    Lanes room_stress(Lanes area, Lanes room) const {
        const Lanes kept = least(room, 1.0 + c.densification_strain);
        return PACKED * c.youngs_modulus * most(kept - area - ROUNDING, Lanes{});
    }

    Lanes crushed_to(int axis, Lanes worst, const Motion& from, const Motion& to) const {
        const Lanes rx = to.x - from.x, ry = to.y - from.y;
        return least(root(rx * rx + ry * ry) * c.per_length[axis] - 1.0, worst);
    }

    // Half of a cell's pressure on its sides, times its thickness [N/m].
    __attribute__((noinline)) Lanes press(int k, const Motion& here, const Motion& right,
                                          const Motion& up, const Motion& far) const {
        const Links &mine = links[k], &above = links[k + 1], &aside = links[k + rows];
        const Lanes along_x = crushed_to(A, mine.bond[A].worst, here, right) +
                              crushed_to(A, above.bond[A].worst, up, far);
        const Lanes along_y = crushed_to(B, mine.bond[B].worst, here, up) +
                              crushed_to(B, aside.bond[B].worst, right, far);
        const Lanes room = (1.0 + 0.5 * along_x) * (1.0 + 0.5 * along_y);
        const Lanes now =
            area(far.x - here.x, far.y - here.y, up.x - right.x, up.y - right.y);
        return 0.5 * c.thickness * rare[k].hold * room_stress(now, room);
    }

    template <int stage>
    __attribute__((always_inline)) void move(int i, int j, int k, const Motion& now, Push force) {
        const Lanes weight = f.weight, ahead = f.ahead;
        Lanes may_x = all(1.0), may_y = all(1.0);
        if (j == 0) may_x -= c.hold_x, may_y -= c.hold_y;
        const Lanes inside = least(now.y - body.trial_y,
                                   c.impactor_half_width - magnitude(now.x - c.impactor_x));
        const Lanes within = most(inside, f.beside - now.y) * may_y;
        if (any_below(Lanes{}, within)) {
            touch<stage>(i, j, now, may_y, force);
        } else if (stage == 0 && rare[k].slips) {
            rare[k].impactor_slip = rare[k].floor_slip = Lanes{};
            rare[k].slips = false;
        }
        const Lanes ax = force.x * f.per_mass * may_x;
        const Lanes ay = (force.y * f.per_mass - c.gravity) * may_y;
        Motion sum = {weight * now.vx, weight * now.vy, weight * ax, weight * ay};
        if (stage > 0) {
            const Motion& before = rate[k];
            sum = {sum.x + before.x, sum.y + before.y, sum.vx + before.vx, sum.vy + before.vy};
        }
        rate[k] = sum;
        const Motion old = stage == 0 ? now : state[k];
        if (stage < LAST_STAGE) {
            trial[k] = {old.x + ahead * now.vx, old.y + ahead * now.vy, old.vx + ahead * ax,
                        old.vy + ahead * ay};
        } else {
            const Motion next = {old.x + sum.x, old.y + sum.y, old.vx + sum.vx, old.vy + sum.vy};
            state[k] = next;
            const Lanes far = magnitude(next.x) + magnitude(next.y) + magnitude(next.vx) +
                              magnitude(next.vy);
            // what is not a number is not below either
            astray += far < ASTRAY ? Lanes{} : all(1.0);
        }
    }

    // Contact of a node. The friction springs are latched at the first stage, whose `rate` still
    // holds the last step's motion.
    template <int stage>
    __attribute__((noinline)) void touch(int i, int j, const Motion& now, Lanes may, Push& force) {
        const int k = at(i, j);
        const Lanes zero = {};
        Rare& own = rare[k];
        Lanes path_x = rate[k].x, path_y = rate[k].y, body_path = body.rate_y;
        if (stage > 0) {
            path_x = now.x - state[k].x, path_y = now.y - state[k].y;
            body_path = body.trial_y - body.y;
        }
        path_y -= body_path;
        // the impactor
        const Lanes x = now.x - c.impactor_x, y = now.y - body.trial_y;
        Lanes distance = all(-NEVER), nx = zero, ny = all(-1.0);
        for (const LanesEdge& edge : edges) {
            const Lanes here = edge.nx * x + edge.ny * y - edge.offset;
            nx = here > distance ? edge.nx : nx;
            ny = here > distance ? edge.ny : ny;
            distance = most(distance, here);
        }
        const Lanes within = least(least(y, c.impactor_half_width - magnitude(x)), -distance);
        const Lanes hits = within > zero ? may : zero;
        const Lanes u = now.vx, v = now.vy - body.trial_v;
        const Lanes spring = -c.contact_stiffness * distance;
        const Lanes damped = spring - c.contact_dashpot * (u * nx + v * ny);
        const Lanes press = hits * most(damped, zero);
        const Lanes most_rub = c.impactor_friction * press;
        const Lanes reach = hits * (own.impactor_slip + (path_y * nx - path_x * ny));
        const Lanes rub = -bounded(c.contact_stiffness * reach, -most_rub, most_rub);
        const Lanes hit_x = press * nx - rub * ny, hit_y = press * ny + rub * nx;
        // the floor: half a cell of foam lies between, or what its worst crush has left of it
        Lanes worst_a = links[k].bond[A].worst, worst_b = links[k].bond[B].worst;
        if (i > 0) worst_a = least(worst_a, links[k - rows].bond[A].worst);
        if (j > 0) worst_b = least(worst_b, links[k - 1].bond[B].worst);
        const Lanes half = 0.5 * c.cell[B];
        const Lanes radius =
            0.5 * least(c.cell[A] * (1.0 + worst_a), c.cell[B] * (1.0 + worst_b));
        const Lanes packed =
            least(now.y - (1.0 + c.densification_strain) * radius, zero) / half;
        const Lanes strain = most((now.y - radius) / half, c.yield_strain);
        const Lanes rests = now.y < half ? may : zero;
        const Lanes stress = c.youngs_modulus * (strain + PACKED * packed);
        const Lanes floor = now.y < radius ? -c.area[B] * stress * rests : zero;
        const Lanes most_drag = c.floor_friction * floor;
        const Lanes along = rests * (own.floor_slip + path_x);
        const Lanes drag = -bounded(c.contact_stiffness * along, -most_drag, most_drag);
        if (stage == 0) {
            own.impactor_slip = -rub / c.contact_stiffness;
            own.floor_slip = -drag / c.contact_stiffness;
            own.slips = true;
        }
        power[CONTACT] -= press * (nx * u + ny * v) + floor * now.vy;
        power[FRICTION] -= rub * (nx * v - ny * u) + drag * now.vx;
        lift -= hit_y;
        force.x += hit_x + drag;
        force.y += hit_y + floor;
    }
};

// Any number of lattices, in packs; the last pack's spare lanes repeat the last lattice.
class Batch {
  public:
    Batch(int count, int columns, int rows, const double* const* constants, int edge_count,
          const double* const* edges, const double* const* starts, const double* const* bodies) {
        for (int first = 0; first < count; first += WIDTH) {
            const double* mine[4][WIDTH];
            for (int lane = 0; lane < WIDTH; ++lane) {
                const int n = min(first + lane, count - 1);
                mine[0][lane] = constants[n], mine[1][lane] = edges[n];
                mine[2][lane] = starts[n], mine[3][lane] = bodies[n];
            }
            packs.push_back(std::make_unique<Lattices>(columns, rows, mine[0], edge_count, mine[1],
                                                       mine[2], mine[3]));
        }
    }
    void advance(long steps, int threads) {
        over_columns(int(packs.size()), threads, [&](int n) { packs[n]->advance(steps); });
    }
    void read(int n, double* nodes, double* summary) const {
        packs[n / WIDTH]->read(n % WIDTH, nodes, summary);
    }

  private:
    std::vector<std::unique_ptr<Lattices>> packs;
};

}  // namespace peer

extern "C" {
int constants_count() { return peer::CONSTANTS; }
int summary_count() { return 5 + peer::WORKS; }
void* create_batch(int count, int columns, int rows, const double* const* constants,
                   int edge_count, const double* const* edges, const double* const* starts,
                   const double* const* bodies) {
    return new peer::Batch(count, columns, rows, constants, edge_count, edges, starts, bodies);
}
void destroy(void* batch) { delete static_cast<peer::Batch*>(batch); }
void advance(void* batch, long steps, int threads) {
    static_cast<peer::Batch*>(batch)->advance(steps, threads);
}
void read(void* batch, int n, double* nodes, double* summary) {
    static_cast<peer::Batch*>(batch)->read(n, nodes, summary);
}
}
