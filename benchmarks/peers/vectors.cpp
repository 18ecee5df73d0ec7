// The same step for a processor's vector units: an array for each quantity, a column's rows one
// after the other, inner loops without branches. What is rare (densification, contact, cells with
// broken sides) has scalar loops of its own, for the columns or cells that need it.
//
// A column is padded to whole vectors. Padded nodes rest on the lattice's grid: lengths there are
// finite, and `free` keeps them where they are. A stage reads one set of arrays and writes another,
// so that a column's nodes can follow its forces while these are still in the cache.
#include <cstdlib>
#include <memory>
#include <vector>

#include "interface.hpp"
#include "lanes.hpp"
#include "model.hpp"

namespace peer {

constexpr int ALIGNMENT = WIDTH * sizeof(double);

class Array {
  public:
    explicit Array(int size, double value = 0.0)
        : data(static_cast<double*>(std::aligned_alloc(ALIGNMENT, size * sizeof(double)))) {
        std::fill(data.get(), data.get() + size, value);
    }
    operator double*() const { return data.get(); }

  private:
    struct Free {
        void operator()(double* memory) const { std::free(memory); }
    };
    std::unique_ptr<double[], Free> data;
};

struct Nodes {
    explicit Nodes(int size) : x(size), y(size), vx(size), vy(size) {}
    Array x, y, vx, vy;
};

struct Forces {
    explicit Forces(int size) : x(size), y(size) {}
    Array x, y;
};

// Of bonds and cells: of bonds A and B on their first nodes, of cells on the second ends of their
// diagonals (`far` from the node that the cell goes by, and `up`).
struct AllForces {
    explicit AllForces(int size) : a(size), b(size), far(size), up(size) {}
    Forces a, b, far, up;
};

// The same of one column, from its first row on.
struct ColumnForces {
    ColumnForces(const AllForces& all, int first)
        : a_x(all.a.x + first), a_y(all.a.y + first), b_x(all.b.x + first), b_y(all.b.y + first),
          far_x(all.far.x + first), far_y(all.far.y + first), up_x(all.up.x + first),
          up_y(all.up.y + first) {}
    double *a_x, *a_y, *b_x, *b_y, *far_x, *far_y, *up_x, *up_y;
};

struct Bonds {
    explicit Bonds(int size)
        : permanent(HAS_RATE ? WIDTH : size), tension(size), worst(size), break_time(size, NEVER),
          intact(SOFTENS ? size : WIDTH), left(SOFTENS ? size : WIDTH) {}
    Array permanent;  // strain without stress; with a rate it is worked out anew each time
    Array tension;    // modulus beyond it [Pa]; 0 tells that a bond is broken
    Array worst, break_time;
    Array intact, left;  // part of the face that pulls, now and after the step
};

struct Column {
    double densified, lift, shear_power, dashpot_power, room_power, astray;
    double breaks;  // bonds that break in this step, or lose a part of their faces
    double work[WORKS];
    bool slips;    // one of its friction springs may be stretched
    bool presses;  // one of its cells may have less area than room in this step
};

class Lattice {
  public:
    Lattice(int columns, int rows, const double* constants, int edge_count, const double* edges,
            const double* start, const double* body)
        : columns(columns), rows(rows), padded((rows + WIDTH - 1) / WIDTH * WIDTH),
          stride(padded + WIDTH), c(constants_from(constants)), state(size()), even(size()),
          odd(size()), rate(size()), bonds{Bonds(size()), Bonds(size())},
          hold(size()), grip(size()), worn(size()), presses(HAS_ROOM ? size() / WIDTH : 0),
          latched(size()), push(size()), impactor_slip(size()),
          floor_slip(size()), free_x(stride), free_y(stride), column(columns), body{} {
        for (int k = 0; k < edge_count; ++k)
            this->edges.push_back({edges[3 * k], edges[3 * k + 1], edges[3 * k + 2]});
        this->body.y = this->body.trial_y = body[0];
        this->body.v = this->body.trial_v = body[1];
        for (int i = -1; i <= columns; ++i)
            for (int j = 0; j < stride; ++j)
                for (const Nodes* nodes : {&state, &even, &odd}) {
                    nodes->x[at(i, j)] = i * c.cell[A];
                    nodes->y[at(i, j)] = (j + 0.5) * c.cell[B];
                }
        for (int i = 0; i < columns; ++i)
            for (int j = 0; j < rows; ++j) {
                const int k = at(i, j);
                const double* from = start + 4 * (i * rows + j);
                state.x[k] = from[0], state.y[k] = from[1];
                state.vx[k] = from[2], state.vy[k] = from[3];
                if (i < columns - 1) bonds[A].break_time[k] = INTACT;
                if (j < rows - 1) bonds[B].break_time[k] = INTACT;
                hold[k] = grip[k] = i < columns - 1 && j < rows - 1;
                for (const Bonds& axis : bonds) {
                    const bool there = axis.break_time[k] == INTACT;
                    axis.tension[k] = there ? c.youngs_modulus : 0.0;
                    if (SOFTENS) axis.intact[k] = axis.left[k] = there;
                }
            }
        for (int j = 0; j < rows; ++j) {
            free_x[j] = j > 0 || c.hold_x == 0.0;
            free_y[j] = j > 0 || c.hold_y == 0.0;
        }
    }

    long advance(long steps, int threads) {
        while (int(scratch.size()) < threads) scratch.emplace_back(stride);
        for (long n = 0; n < steps; ++n) {
            take_stock();
            for (const int k : torn) let_go(k);
            if (HAS_ROOM) over_columns(columns - 1, threads, [this](int i) { look_column(i); });
            over_columns(columns, threads,
                         [this](int i) { forces_of<0>(state, i, {latched, at(i, 0)}); });
            run_stage<0>(state, even, threads);
            run_stage<1>(even, odd, threads);
            run_stage<2>(odd, even, threads);
            run_stage<LAST_STAGE>(even, state, threads);
            time += step;
            break_bonds();
            for (const Column& sums : column)
                if (sums.astray > 0.0) return n;
        }
        return steps;
    }

    void read(double* nodes, double* summary) const {
        for (int i = 0; i < columns; ++i)
            for (int j = 0; j < rows; ++j) {
                const int k = at(i, j);
                double* to = nodes + 4 * (i * rows + j);
                to[0] = state.x[k], to[1] = state.y[k], to[2] = state.vx[k], to[3] = state.vy[k];
            }
        summary[0] = time;
        summary[1] = step;
        summary[2] = body.y;
        summary[3] = body.v;
        summary[4] = broken;
        for (int k = 0; k < WORKS; ++k) {
            summary[5 + k] = 0.0;
            for (const Column& sums : column) summary[5 + k] += sums.work[k];
        }
    }

  private:
    struct Scratch {  // forces of two columns, this one's and the one to the left
        explicit Scratch(int size) : columns{AllForces(size), AllForces(size)} {}
        AllForces columns[2];
        // the first row has none below it: what lies before it stays 0
        ColumnForces of(int i) const { return ColumnForces(columns[(i + 2) % 2], WIDTH); }
    };

    int columns, rows, padded, stride;
    Constants c;
    Nodes state, even, odd, rate;
    Bonds bonds[2];
    Array hold;          // what cells hold of their forces
    Array grip;          // the same, but 0 if both sides along an axis are broken: they carry it
    AllForces latched;   // that the first stage takes from the latch
    Forces push;         // contact forces in columns that touch something
    Array impactor_slip, floor_slip;  // stretch of the friction springs [m]
    Array free_x, free_y;             // by row: 1 where a node may move, else 0
    std::vector<Column> column;
    std::vector<char> worn;        // 1 of each cell in `torn`
    std::vector<int> torn;         // cells with a side that is broken, or only a part of it whole
    std::vector<char> presses;     // by vectors of cells, see Column
    std::vector<Scratch> scratch;  // one for each thread
    std::vector<Edge> edges;
    Body body;
    double time = 0.0, step = 0.0;
    double lag_kept = 1.0;  // part of a bond's lag that is left after this step
    int broken = 0;

    int size() const { return (columns + 2) * stride; }
    int at(int i, int j) const { return (i + 1) * stride + j; }

    // Forces of a column's bonds along one axis on their first nodes, short of densification; the
    // column's deepest strain comes back. The first stage brings the worst strain up to date, the
    // last finds what fails; of a column that another thread records, neither.
    template <int axis, int stage, bool recording>
    double bond_column(const Nodes& now, int i, double* force_x, double* force_y) {
        const int first = at(i, 0);
        const int along = axis == A ? stride : 1, side = axis == A ? 1 : stride;
        const double *x = now.x + first, *y = now.y + first;
        const double *vx = now.vx + first, *vy = now.vy + first;
        const Bonds& mine = bonds[axis];
        double *permanent = mine.permanent + first, *tension = mine.tension + first;
        double *worst = mine.worst + first, *break_time = mine.break_time + first;
        const double* intact = SOFTENS ? mine.intact + first : nullptr;
        const Lanes zero = {}, one = all(1.0), modulus = all(c.youngs_modulus);
        const Lanes yield = all(c.yield_strain), damping = all(c.dashpot[axis]);
        const Lanes densified = all(c.densification_strain);
        const double* carried = grip + first;
        const double per_length = c.per_length[axis], area = c.area[axis];
        const double modulus_per_area = c.shear_modulus * c.per_length[A] * c.per_length[B];
        Lanes deepest = zero, dashpot_power = zero, breaks = zero;
        for (int j = 0; j < padded; j += WIDTH) {
            const int end = j + along;
            const Lanes xj = load(x + j), yj = load(y + j);
            const Lanes x_end = load(x + end), y_end = load(y + end);
            const Lanes rx = x_end - xj, ry = y_end - yj;
            const Lanes length = root(rx * rx + ry * ry);
            const Lanes e = length * per_length - 1.0;
            Lanes opening = load(tension + j), elastic, pressed;
            const Lanes whole = opening > zero ? one : zero;
            const Lanes holds = SOFTENS ? load(intact + j) : whole;  // part of its face
            if (HAS_RATE) {
                Lanes met = load(worst + j);
                if (stage == 0) {
                    const Lanes from = least(most(e, yield), met);
                    const Lanes lag = most(from - e, zero);
                    met = from - (lag - lag * lag_kept);
                }
                const Lanes flowing = least(met, yield);
                const Lanes rest = most(flowing, densified) - yield;
                if (stage == 0) {
                    const Lanes slack = c.crushed_stress / (c.crushed_strain - rest);
                    opening = whole * (met < yield ? slack : modulus);
                    store(worst + j, met);
                    store(tension + j, opening);
                }
                elastic = e - rest;
                pressed = most(elastic, yield) + least(e - flowing, zero);
            } else {
                elastic = e - load(permanent + j);
                pressed = most(elastic, yield);
            }
            const Lanes closed = modulus * least(pressed, zero);
            const Lanes opened = opening * most(elastic, zero);
            const Lanes stress = closed + opened;  // of a whole bond
            const Lanes held = SOFTENS ? closed + holds * opened : stress;
            const Lanes per_reach = one / length;
            const Lanes relative_x = load(vx + end) - load(vx + j);
            const Lanes relative_y = load(vy + end) - load(vy + j);
            const Lanes closing = rx * relative_x + ry * relative_y;
            const Lanes rate = closing * per_reach;
            const Lanes pull = (area * held + holds * damping * rate) * per_reach;
            store(force_x + j, pull * rx);
            store(force_y + j, pull * ry);
            deepest = least(deepest, e);
            if (!recording) continue;
            // not by way of the drag: whether a compiler fuses a product with a sum hangs on who else
            // wants the product, and a column that is not recorded has to get the same forces
            dashpot_power += holds * rate * rate;
            if (stage == 0 && !HAS_RATE) {
                const Lanes deeper = least(load(worst + j), e);
                const Lanes rest = least(most(deeper, densified), yield) - yield;
                const Lanes slack = c.crushed_stress / (c.crushed_strain - rest);
                store(worst + j, deeper);
                store(permanent + j, rest);
                store(tension + j, whole * (deeper < yield ? slack : modulus));
            }
            if (stage == LAST_STAGE) {
                const Lanes met = HAS_RATE ? load(worst + j) : least(load(worst + j), e);
                const Lanes limit = met < yield ? all(c.crushed_strain) : all(c.tensile_strain);
                // its shear is that of the cells on both its sides, of those that carry any
                const Lanes ahead = load(carried + j) > zero ? one : zero;
                const Lanes behind = load(carried + j - side) > zero ? one : zero;
                const Lanes ahead_x = load(x + j + side) - xj + (load(x + end + side) - x_end);
                const Lanes ahead_y = load(y + j + side) - yj + (load(y + end + side) - y_end);
                const Lanes behind_x = xj - load(x + j - side) + (x_end - load(x + end - side));
                const Lanes behind_y = yj - load(y + j - side) + (y_end - load(y + end - side));
                const Lanes across_x = ahead * ahead_x + behind * behind_x;
                const Lanes across_y = ahead * ahead_y + behind * behind_y;
                const Lanes differences = 2.0 * most(ahead + behind, one);
                const Lanes tau = modulus_per_area * (rx * across_x + ry * across_y) / differences;
                const Lanes pressure = e < zero ? magnitude(stress) : zero;
                const Lanes strength = c.shear_strength + c.pressure_coefficient * pressure;
                if (SOFTENS) {
                    const Lanes beyond = most(e - limit, magnitude(tau) - strength);
                    if (any_below(zero, whole * beyond))
                        breaks += soften<axis>(first + j, e / limit, magnitude(tau) / strength);
                    continue;
                }
                const auto fails = most(e - limit, magnitude(tau) - strength) > zero;
                const Lanes failed = fails ? whole : zero;
                store(break_time + j, failed > zero ? all(BREAKING) : load(break_time + j));
                breaks += failed;
            }
        }
        if (axis == B) {  // the last row has no bond above it
            force_x[rows - 1] = force_y[rows - 1] = 0.0;
            if (stage == 0) worst[rows - 1] = 0.0;
        }
        if (recording) {
            column[i].dashpot_power += c.dashpot[axis] * sum(dashpot_power);
            column[i].breaks += sum(breaks);
        }
        return least_of(deepest);
    }

    // Beyond its limit a bond holds ever less. How many of a vector of bonds lose a part.
    template <int axis>
    Lanes soften(int k, Lanes pulled, Lanes sheared) {
        const Bonds& mine = bonds[axis];
        const Lanes one = all(1.0), intact = load(mine.intact + k);
        const auto holds = [&](Lanes overload, double tail) {
            const Lanes fallen = (tail - overload) / (overload * max(tail - 1.0, 1e-9));
            return overload > one ? most(fallen, Lanes{}) : one;
        };
        Lanes left = least(holds(pulled, c.tensile_tail[axis]), holds(sheared, c.shear_tail[axis]));
        for (int n = 0; n < WIDTH; ++n) left[n] = float(left[n]);
        left = least(left, intact);
        store(mine.left + k, left);
        return left < intact ? one : Lanes{};
    }

    // Forces of a column's cells along their diagonals: elastic and viscous.
    template <bool recording>
    void cell_column(const Nodes& now, int i, const ColumnForces& to) {
        const int first = at(i, 0);
        const double *x = now.x + first, *y = now.y + first;
        const double *vx = now.vx + first, *vy = now.vy + first;
        const double* carried = grip + first;
        const double per_area = c.per_length[A] * c.per_length[B];
        // thickness times stress, halved, is a force over a diagonal's length
        const double elasticity = 0.5 * c.thickness * c.shear_modulus * (0.25 * per_area);
        const double viscosity = 0.5 * c.thickness * c.shear_viscosity * (0.5 * per_area);
        Lanes shear_power = {}, dashpot_power = {};
        for (int j = 0; j < padded; j += WIDTH) {
            const int right = j + stride, up = j + 1, far = right + 1;
            const Lanes d1x = load(x + far) - load(x + j), d1y = load(y + far) - load(y + j);
            const Lanes d2x = load(x + up) - load(x + right), d2y = load(y + up) - load(y + right);
            const Lanes d1u = load(vx + far) - load(vx + j), d1v = load(vy + far) - load(vy + j);
            const Lanes d2u = load(vx + up) - load(vx + right);
            const Lanes d2v = load(vy + up) - load(vy + right);
            const Lanes share = load(carried + j);
            const Lanes squares = (d1x * d1x + d1y * d1y) - (d2x * d2x + d2y * d2y);
            const Lanes closing = (d1x * d1u + d1y * d1v) - (d2x * d2u + d2y * d2v);
            const Lanes pull = share * (elasticity * squares + viscosity * closing);
            store(to.far_x + j, -pull * d1x);
            store(to.far_y + j, -pull * d1y);
            store(to.up_x + j, pull * d2x);
            store(to.up_y + j, pull * d2y);
            if (!recording) continue;
            shear_power += share * closing * squares;
            dashpot_power += share * closing * closing;
        }
        if (recording) {
            column[i].shear_power += elasticity * sum(shear_power);
            column[i].dashpot_power += viscosity * sum(dashpot_power);
        }
    }

    // Room of a vector of cells by the strains along their sides, over their area at rest.
    static Lanes room_of(Lanes below, Lanes above, Lanes left, Lanes right) {
        return (1.0 + 0.5 * (below + above)) * (1.0 + 0.5 * (left + right));
    }

    Lanes room_stress(Lanes area, Lanes room) const {
        const Lanes kept = least(room, all(1.0 + c.densification_strain));
        return PACKED * c.youngs_modulus * most(kept - area - ROUNDING, Lanes{});
    }

    // Before a step: which of a column's cells may have less area than room in it.
    void look_column(int i) {
        const int first = at(i, 0);
        const double *x = state.x + first, *y = state.y + first, *held = hold + first;
        const double *a = bonds[A].worst + first, *b = bonds[B].worst + first;
        const Lanes zero = {}, densified = all(1.0 + c.densification_strain);
        column[i].presses = false;
        for (int j = 0; j < padded; j += WIDTH) {
            const int right = j + stride, up = j + 1, far = right + 1;
            const Lanes d1x = load(x + far) - load(x + j), d1y = load(y + far) - load(y + j);
            const Lanes d2x = load(x + up) - load(x + right), d2y = load(y + up) - load(y + right);
            const Lanes area =
                (d1x * d2y - d1y * d2x) * (0.5 * c.per_length[A] * c.per_length[B]);
            char& found = presses[(first + j) / WIDTH];
            found = any_below(area - NEAR, densified);
            if (!found) continue;
            const Lanes room = room_of(load(a + j), load(a + up), load(b + j), load(b + right));
            found = any_below(zero, room_stress(area - NEAR, room) * load(held + j));
            column[i].presses |= found;
        }
    }

    // Add the forces by which a column's cells keep their room.
    template <bool recording>
    void press_column(const Nodes& now, int i, const ColumnForces& to) {
        if (!column[i].presses) return;
        const int first = at(i, 0);
        const double *x = now.x + first, *y = now.y + first;
        const double *vx = now.vx + first, *vy = now.vy + first;
        const double *a = bonds[A].worst + first, *b = bonds[B].worst + first;
        const double* held = hold + first;
        Lanes power = {};
        for (int j = 0; j < padded; j += WIDTH) {
            if (!presses[(first + j) / WIDTH]) continue;
            const int right = j + stride, up = j + 1, far = right + 1;
            const auto crushed = [&](int axis, const double* worst, int from, int to) {
                const Lanes rx = load(x + to) - load(x + from), ry = load(y + to) - load(y + from);
                const Lanes e = root(rx * rx + ry * ry) * c.per_length[axis] - 1.0;
                return least(e, load(worst + from));
            };
            const Lanes d1x = load(x + far) - load(x + j), d1y = load(y + far) - load(y + j);
            const Lanes d2x = load(x + up) - load(x + right), d2y = load(y + up) - load(y + right);
            const Lanes area =
                (d1x * d2y - d1y * d2x) * (0.5 * c.per_length[A] * c.per_length[B]);
            const Lanes room = room_of(crushed(A, a, j, right), crushed(A, a, up, far),
                                       crushed(B, b, j, up), crushed(B, b, right, far));
            const Lanes half = 0.5 * c.thickness * load(held + j) * room_stress(area, room);
            store(to.far_x + j, load(to.far_x + j) + half * d2y);
            store(to.far_y + j, load(to.far_y + j) - half * d2x);
            store(to.up_x + j, load(to.up_x + j) - half * d1y);
            store(to.up_y + j, load(to.up_y + j) + half * d1x);
            if (!recording) continue;
            const Lanes d1u = load(vx + far) - load(vx + j), d1v = load(vy + far) - load(vy + j);
            const Lanes d2u = load(vx + up) - load(vx + right);
            const Lanes d2v = load(vy + up) - load(vy + right);
            power -= half * ((d2y * d1u - d2x * d1v) + (d1x * d2v - d1y * d2u));
        }
        if (recording) column[i].room_power += sum(power);
    }

    // Add densification to the forces of a column's bonds; the stiffest [N/m] comes back.
    template <int axis>
    double densify(const Nodes& now, int i, double* force_x, double* force_y) {
        const int first = at(i, 0), along = axis == A ? stride : 1;
        const double dense_length = c.cell[axis] * (1.0 + c.densification_strain);
        double stiffest = 0.0;
        for (int j = 0; j < (axis == A ? rows : rows - 1); ++j) {
            const int k = first + j, end = k + along;
            const double rx = now.x[end] - now.x[k], ry = now.y[end] - now.y[k];
            const double square = rx * rx + ry * ry;
            if (square >= dense_length * dense_length) continue;
            const double length = std::sqrt(square);
            const Dense dense = densification(c, length * c.per_length[axis] - 1.0);
            const double pull = c.area[axis] * dense.stress / length;
            force_x[j] += pull * rx;
            force_y[j] += pull * ry;
            stiffest = max(stiffest, dense.slope * c.area[axis] * c.per_length[axis]);
        }
        return stiffest;
    }

    template <int axis, int stage, bool recording>
    void bonds_of(const Nodes& now, int i, double* force_x, double* force_y) {
        if (bond_column<axis, stage, recording>(now, i, force_x, force_y) >= c.densification_strain)
            return;
        const double stiffest = densify<axis>(now, i, force_x, force_y);
        if (recording) column[i].densified = max(column[i].densified, stiffest);
    }

    // What a column's right side has, which pulls at the column to the right too.
    template <int stage, bool recording>
    void right_of(const Nodes& now, int i, const ColumnForces& to) {
        if (i >= 0 && i < columns - 1) {
            bonds_of<A, stage, recording>(now, i, to.a_x, to.a_y);
            cell_column<recording>(now, i, to);
            if (HAS_ROOM) press_column<recording>(now, i, to);
            return;
        }
        for (double* none : {to.a_x, to.a_y, to.far_x, to.far_y, to.up_x, to.up_y})
            std::fill(none, none + padded, 0.0);
    }

    template <int stage>
    void forces_of(const Nodes& now, int i, const ColumnForces& to) {
        Column& sums = column[i];
        sums.densified = sums.breaks = 0.0;
        sums.shear_power = sums.dashpot_power = sums.room_power = 0.0;
        right_of<stage, true>(now, i, to);
        bonds_of<B, stage, true>(now, i, to.b_x, to.b_y);
    }

    // The stiffness is that of the last stage's forces, which looked at the step's end.
    void take_stock() {
        double densified = 0.0;
        for (const Column& sums : column) densified = max(densified, sums.densified);
        step = c.step > 0.0 ? c.step : stable_step(c, densified);
        if (HAS_RATE) lag_kept = lag_left(c, step);
    }

    // What has failed in a step is broken from its end on.
    void break_bonds() {
        double breaks = 0.0;
        for (const Column& sums : column) breaks += sums.breaks;
        if (breaks == 0.0) return;
        for (int i = 0; i < columns; ++i) {
            if (column[i].breaks == 0.0) continue;
            for (int axis : {A, B})
                for (int k = at(i, 0); k < at(i, rows); ++k) take_from(axis, k);
        }
    }

    void take_from(int axis, int k) {
        const Bonds& mine = bonds[axis];
        bool breaks = mine.break_time[k] == BREAKING;
        if (SOFTENS) {
            if (!(mine.left[k] < mine.intact[k])) return;
            mine.intact[k] = mine.left[k];
            breaks = mine.left[k] == 0.0;
        } else if (!breaks) {
            return;
        }
        if (breaks) mine.break_time[k] = time, mine.tension[k] = 0.0, ++broken;
        for (int cell : {k, k - (axis == A ? 1 : stride)})
            if (hold[cell] > 0.0 && !worn[cell]) worn[cell] = 1, torn.push_back(cell);
    }

    // Part of a bond's face that pulls.
    double pulls(int axis, int k) const {
        return SOFTENS ? bonds[axis].intact[k] : whole(axis, k);
    }

    // Before a step: a cell lets go as cracks pull it apart. What it holds only falls.
    void let_go(int k) {
        const int right = k + stride, up = k + 1, far = right + 1;
        const Vec d1 = {state.x[far] - state.x[k], state.y[far] - state.y[k]};
        const Vec d2 = {state.x[up] - state.x[right], state.y[up] - state.y[right]};
        const bool is_whole = whole(A, k) && whole(A, up) && whole(B, k) && whole(B, right);
        if (!is_whole) hold[k] = hold_left(c, d1, d2, hold[k]);
        // it hangs together by one of its two sides along each axis
        const double along_x = max(pulls(A, k), pulls(A, up));
        grip[k] = hold[k] * along_x * max(pulls(B, k), pulls(B, right));
    }

    // One stage of all columns, cut into a piece for each thread.
    template <int stage>
    void run_stage(const Nodes& now, const Nodes& next, int threads) {
        constexpr bool has_forces = stage == 0;
        over_columns(threads, threads, [&](int piece) {
            const int first = int(long(columns) * piece / threads);
            const int last = int(long(columns) * (piece + 1) / threads);
            Scratch& own = scratch[piece];
            if (!has_forces) right_of<stage, false>(now, first - 1, own.of(first - 1));
            for (int i = first; i < last; ++i) {
                if (has_forces) {
                    node_column<stage>(now, next, i, {latched, at(i, 0)}, {latched, at(i - 1, 0)});
                } else {
                    forces_of<stage>(now, i, own.of(i));
                    node_column<stage>(now, next, i, own.of(i), own.of(i - 1));
                }
            }
        });
        double lift = 0.0;
        for (const Column& sums : column) lift += sums.lift;
        body_stage(c, body, stage, step, lift);
    }

    // Gather the forces on a column's nodes, and take the stage.
    template <int stage>
    void node_column(const Nodes& now, const Nodes& next, int i, const ColumnForces& f,
                     const ColumnForces& left) {
        Column& sums = column[i];
        double power[WORKS] = {};
        sums.lift = 0.0;
        sums.astray = 0.0;
        if (touches(now, i)) {
            touch_column<stage>(now, i, power);
            move_column<stage, true>(now, next, i, f, left, power);
            sums.slips = true;
        } else {
            if (stage == 0 && sums.slips) {
                std::fill(impactor_slip + at(i, 0), impactor_slip + at(i, rows), 0.0);
                std::fill(floor_slip + at(i, 0), floor_slip + at(i, rows), 0.0);
                sums.slips = false;
            }
            move_column<stage, false>(now, next, i, f, left, power);
        }
        power[SHEAR] = sums.shear_power;
        power[DASHPOTS] = sums.dashpot_power;
        if (HAS_ROOM) power[PRESSING] = sums.room_power;
        const double weight = stage_weight(stage, step);
        for (int k = 0; k < WORKS; ++k) sums.work[k] += weight * power[k];
    }

    // Whether a column has a node in the impactor's box, or closer to the floor than half a cell.
    bool touches(const Nodes& now, int i) const {
        const double *x = now.x + at(i, 0), *y = now.y + at(i, 0), *may = free_y;
        const Lanes zero = {}, half = all(0.5 * c.cell[B]), half_width = all(c.impactor_half_width);
        Lanes found = zero;
        for (int j = 0; j < padded; j += WIDTH) {
            const Lanes aside = magnitude(load(x + j) - c.impactor_x);
            const Lanes inside = least(load(y + j) - body.trial_y, half_width - aside);
            found += most(inside, half - load(y + j)) > zero ? load(may + j) : zero;
        }
        return sum(found) > 0.0;
    }

    // Contact of one column, node by node. The friction springs are latched at the first stage,
    // whose `rate` still holds the last step's motion.
    template <int stage>
    void touch_column(const Nodes& now, int i, double* power) {
        const double body_path = stage > 0 ? body.trial_y - body.y : body.rate_y;
        for (int j = 0; j < rows; ++j) {
            const int k = at(i, j);
            push.x[k] = push.y[k] = 0.0;
            if (free_y[j] == 0.0) continue;
            Vec path = {rate.x[k], rate.y[k]};
            if (stage > 0) path = {now.x[k] - state.x[k], now.y[k] - state.y[k]};
            const Vec relative = {now.vx[k], now.vy[k] - body.trial_v};
            const Touch hit = impactor_contact(
                c, edges.data(), int(edges.size()),
                {now.x[k] - c.impactor_x, now.y[k] - body.trial_y}, relative,
                {path.x, path.y - body_path}, impactor_slip[k]);
            const Touch floor = floor_contact(
                c, now.y[k], min(bonds[A].worst[k], bonds[A].worst[k - stride]),
                min(bonds[B].worst[k], bonds[B].worst[k - 1]), path.x, floor_slip[k]);
            if (stage == 0) {
                impactor_slip[k] = hit.stretch;
                floor_slip[k] = floor.stretch;
            }
            power[CONTACT] -= dot(hit.pressing, relative) + floor.pressing.y * now.vy[k];
            power[FRICTION] -= dot(hit.rubbing, relative) + floor.rubbing.x * now.vx[k];
            column[i].lift -= hit.pressing.y + hit.rubbing.y;
            push.x[k] = hit.pressing.x + hit.rubbing.x + floor.rubbing.x;
            push.y[k] = hit.pressing.y + hit.rubbing.y + floor.pressing.y;
        }
    }

    template <int stage, bool touched>
    void move_column(const Nodes& now, const Nodes& next, int i, const ColumnForces& f,
                     const ColumnForces& left, double* power) {
        const int first = at(i, 0);
        const double *vx = now.vx + first, *vy = now.vy + first;
        const double *old_x = state.x + first, *old_y = state.y + first;
        const double *old_vx = state.vx + first, *old_vy = state.vy + first;
        double *new_x = next.x + first, *new_y = next.y + first;
        double *new_vx = next.vx + first, *new_vy = next.vy + first;
        double *rate_x = rate.x + first, *rate_y = rate.y + first;
        double *rate_vx = rate.vx + first, *rate_vy = rate.vy + first;
        const double *push_x = push.x + first, *push_y = push.y + first;
        const double *may_x = free_x, *may_y = free_y;
        const double weight = stage_weight(stage, step), ahead = stage_ahead(stage, step);
        const double per_mass = 1.0 / c.node_mass, gravity = c.gravity;
        Lanes taken = {}, strange = {};
        for (int j = 0; j < padded; j += WIDTH) {
            const Lanes vxj = load(vx + j), vyj = load(vy + j);
            Lanes fx = load(f.a_x + j) - load(left.a_x + j);
            Lanes fy = load(f.a_y + j) - load(left.a_y + j);
            fx += load(f.b_x + j) - load(f.b_x + j - 1);
            fy += load(f.b_y + j) - load(f.b_y + j - 1);
            // each of four cells has the node at another corner: its upper, first, far, right one
            fx += load(f.up_x + j - 1) - load(f.far_x + j);
            fy += load(f.up_y + j - 1) - load(f.far_y + j);
            fx += load(left.far_x + j - 1) - load(left.up_x + j);
            fy += load(left.far_y + j - 1) - load(left.up_y + j);
            taken -= fx * vxj + fy * vyj;
            if (touched) {
                fx += load(push_x + j);
                fy += load(push_y + j);
            }
            const Lanes ax = fx * per_mass * load(may_x + j);
            const Lanes ay = (fy * per_mass - gravity) * load(may_y + j);
            Lanes sum_x = weight * vxj, sum_y = weight * vyj;
            Lanes sum_vx = weight * ax, sum_vy = weight * ay;
            if (stage > 0) {
                sum_x += load(rate_x + j);
                sum_y += load(rate_y + j);
                sum_vx += load(rate_vx + j);
                sum_vy += load(rate_vy + j);
            }
            store(rate_x + j, sum_x);
            store(rate_y + j, sum_y);
            store(rate_vx + j, sum_vx);
            store(rate_vy + j, sum_vy);
            const bool last = stage == LAST_STAGE;
            const Lanes px = load(old_x + j) + (last ? sum_x : ahead * vxj);
            const Lanes py = load(old_y + j) + (last ? sum_y : ahead * vyj);
            const Lanes qx = load(old_vx + j) + (last ? sum_vx : ahead * ax);
            const Lanes qy = load(old_vy + j) + (last ? sum_vy : ahead * ay);
            store(new_x + j, px);
            store(new_y + j, py);
            store(new_vx + j, qx);
            store(new_vy + j, qy);
            if (last) {
                const Lanes far = magnitude(px) + magnitude(py) + magnitude(qx) + magnitude(qy);
                // what is not a number is not below either
                strange += far < ASTRAY ? Lanes{} : all(1.0);
            }
        }
        power[BONDS] += sum(taken);
        column[i].astray = sum(strange);
    }

    bool whole(int axis, int k) const { return bonds[axis].break_time[k] == INTACT; }
};

}  // namespace peer

PEER_INTERFACE(peer::Lattice)
