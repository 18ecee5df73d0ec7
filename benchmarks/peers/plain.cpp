// The lattice's Runge-Kutta step, plainly: a struct for each node, and two passes a stage. The
// first finds the forces of each node's two bonds and of the cell between them, the second gathers
// those of the four bonds and four cells around a node.
#include <vector>

#include "interface.hpp"
#include "model.hpp"

namespace peer {

struct Node {
    Real x, y, vx, vy;
};

struct Bond {
    Real worst;  // the most compressive strain so far
    Real break_time;
};

struct Cell {  // the one to the right of and above a node
    Real hold;  // what it holds of its forces
    Real grip;  // the same, but 0 if both its sides along an axis are broken: it carries so much
};

struct Forces {
    Vec bond[2];      // of a node's two bonds on it [N]
    Vec diagonal[2];  // of its cell on the second ends: far from the node, and above it
};

// What a column of nodes adds up; sums over columns have one order for any number of threads.
struct Column {
    Real densified;  // its stiffest densified bond [N/m]
    Real lift;       // its force on the impactor [N]
    Real shear_power, dashpot_power;  // at this stage [W]
    Real work[WORKS];
    int breaks;
    bool astray;
};

class Lattice {
  public:
    Lattice(int columns, int rows, const double* constants, int edge_count, const double* edges,
            const double* start, const double* body)
        : columns(columns), rows(rows), stride(rows + 2), c(constants_from(constants)),
          state(nodes()), trial(nodes()), rate(nodes()), forces(nodes()),
          bonds{std::vector<Bond>(nodes()), std::vector<Bond>(nodes())},
          cells(nodes()), impactor_slip(nodes()), floor_slip(nodes()), column(columns), body{} {
        for (int k = 0; k < edge_count; ++k)
            this->edges.push_back({edges[3 * k], edges[3 * k + 1], edges[3 * k + 2]});
        this->body.y = this->body.trial_y = body[0];
        this->body.v = this->body.trial_v = body[1];
        for (auto& axis : bonds) std::fill(axis.begin(), axis.end(), Bond{0.0, NEVER});
        for (int i = 0; i < columns; ++i)
            for (int j = 0; j < rows; ++j) {
                const double* from = start + 4 * (i * rows + j);
                trial[at(i, j)] = state[at(i, j)] = {from[0], from[1], from[2], from[3]};
                if (i < columns - 1) bonds[A][at(i, j)].break_time = INTACT;
                if (j < rows - 1) bonds[B][at(i, j)].break_time = INTACT;
                if (i < columns - 1 && j < rows - 1) cells[at(i, j)] = {1.0, 1.0};
            }
    }

    long advance(long steps, int threads) {
        for (long n = 0; n < steps; ++n) {
            take_stock();
            for (int stage = 0; stage <= LAST_STAGE; ++stage) {
                over_columns(columns, threads, [=](int i) { force_column(i, stage); });
                over_columns(columns, threads, [=](int i) { node_column(i, stage); });
                Real lift = 0.0;
                for (const Column& sums : column) lift += sums.lift;
                body_stage(c, body, stage, step, lift);
            }
            time += step;
            break_bonds();
            over_columns(columns, threads, [=](int i) { look_column(i); });
            for (const Column& sums : column)
                if (sums.astray) return n;
        }
        return steps;
    }

    void read(double* nodes, double* summary) const {
        for (int i = 0; i < columns; ++i)
            for (int j = 0; j < rows; ++j) {
                const Node& node = state[at(i, j)];
                double* to = nodes + 4 * (i * rows + j);
                to[0] = double(node.x), to[1] = double(node.y);
                to[2] = double(node.vx), to[3] = double(node.vy);
            }
        summary[0] = double(time);
        summary[1] = double(step);
        summary[2] = double(body.y);
        summary[3] = double(body.v);
        summary[4] = broken;
        for (int k = 0; k < WORKS; ++k) {
            summary[5 + k] = 0.0;
            for (const Column& sums : column) summary[5 + k] += double(sums.work[k]);
        }
    }

  private:
    int columns, rows, stride;  // arrays have a rim of one node, so that all have neighbours
    Constants c;
    std::vector<Node> state, trial, rate;  // accepted, at this stage, weighted sum of stages
    std::vector<Forces> forces;
    std::vector<Bond> bonds[2];
    std::vector<Cell> cells;
    std::vector<Real> impactor_slip, floor_slip;  // stretch of the friction springs [m]
    std::vector<Column> column;
    std::vector<Edge> edges;
    Body body;
    Real time = 0.0, step = 0.0;
    Real lag_kept = 1.0;  // part of a bond's lag that is left after this step
    int broken = 0;

    int nodes() const { return (columns + 2) * stride; }
    int at(int i, int j) const { return (i + 1) * stride + j + 1; }

    Vec apart(int from, int to) const {
        return {trial[to].x - trial[from].x, trial[to].y - trial[from].y};
    }

    Vec apart_velocity(int from, int to) const {
        return {trial[to].vx - trial[from].vx, trial[to].vy - trial[from].vy};
    }

    // Force of a bond on its first node k. The first stage, whose state is the accepted one, brings
    // the worst strain up to date; the last, which looks at the step's end, finds what fails.
    template <int axis>
    Vec bond_force(const Constants& c, int k, int stage, Column& sums) {
        const int end = k + (axis == A ? stride : 1);
        Bond& bond = bonds[axis][k];
        const bool intact = bond.break_time < 0.0;
        const Vec reach = apart(k, end);
        const Real square = dot(reach, reach), length = sqrt(square);
        const Real e = length * c.per_length[axis] - 1.0;
        if (stage == 0 && e < bond.worst)
            bond.worst = HAS_RATE ? flowed_strain(c, e, bond.worst, lag_kept) : e;
        const Real worst = bond.worst;
        const Real yielding = yielding_stress(c, e, worst, !intact);
        Real stress = yielding;
        if (e < c.densification_strain) {
            const Dense dense = densification(c, e);
            stress += dense.stress;
            sums.densified = max(sums.densified, dense.slope * c.area[axis] * c.per_length[axis]);
        }
        Real pull = c.area[axis] * stress / length;
        if (intact) {
            const Real closing = dot(reach, apart_velocity(k, end));
            const Real drag = c.dashpot[axis] * closing / square;
            pull += drag;
            sums.dashpot_power += drag * closing;
            if (stage == LAST_STAGE && fails<axis>(c, k, reach, e, worst, yielding)) {
                bond.break_time = BREAKING;
                sums.breaks += 1;
            }
        }
        return {pull * reach.x, pull * reach.y};
    }

    // Its shear is that of the cells on both its sides, of those that carry any.
    template <int axis>
    bool fails(const Constants& c, int k, Vec reach, Real e, Real worst, Real stress) const {
        const int end = k + (axis == A ? stride : 1), side = axis == A ? 1 : stride;
        if (e > tensile_limit(c, HAS_RATE ? worst : min(worst, e))) return true;
        Vec across = {0.0, 0.0};
        int differences = 0;
        for (int near : {k, k - side}) {  // the nodes between which a side lies
            if (cells[near].grip <= 0.0) continue;
            const Vec here = apart(near, near + side);
            const Vec there = apart(near + end - k, near + end - k + side);
            across = {across.x + here.x + there.x, across.y + here.y + there.y};
            differences += 2;
        }
        if (differences == 0) return false;
        const Real gamma = dot(reach, across) * c.per_length[A] * c.per_length[B] / differences;
        return fails_in_shear(c, e, stress, c.shear_modulus * gamma);
    }

    // Forces of a cell along its two diagonals, on their second ends: elastic and viscous.
    void cell_forces(const Constants& c, int k, Column& sums) {
        const int right = k + stride, up = k + 1, far = right + 1;
        const Vec d1 = apart(k, far), d2 = apart(right, up);
        const Real per_area = c.per_length[A] * c.per_length[B];
        // thickness times stress, halved, is a force over a diagonal's length
        const Real half = 0.5 * c.thickness * cells[k].grip;
        const Real gamma = (dot(d1, d1) - dot(d2, d2)) * (0.25 * per_area);
        const Real closing = dot(d1, apart_velocity(k, far)) - dot(d2, apart_velocity(right, up));
        const Real elastic = half * c.shear_modulus * gamma;
        const Real viscous = half * c.shear_viscosity * (0.5 * per_area) * closing;
        const Real pull = elastic + viscous;
        forces[k].diagonal[0] = {-pull * d1.x, -pull * d1.y};
        forces[k].diagonal[1] = {pull * d2.x, pull * d2.y};
        sums.shear_power += elastic * closing;
        sums.dashpot_power += viscous * closing;
    }

    void force_column(int i, int stage) {
        const Constants c = this->c;
        Column sums = column[i];
        sums.densified = 0.0;
        sums.shear_power = sums.dashpot_power = 0.0;
        sums.breaks = 0;
        for (int j = 0; j < rows; ++j) {
            const int k = at(i, j);
            if (i < columns - 1) forces[k].bond[A] = bond_force<A>(c, k, stage, sums);
            if (j < rows - 1) forces[k].bond[B] = bond_force<B>(c, k, stage, sums);
            if (i < columns - 1 && j < rows - 1) cell_forces(c, k, sums);
        }
        column[i] = sums;
    }

    // The stiffness is that of the last stage's forces, which looked at the step's end.
    void take_stock() {
        Real densified = 0.0;
        for (const Column& sums : column) densified = max(densified, sums.densified);
        step = c.step > 0.0 ? c.step : stable_step(c, densified);
        if (HAS_RATE) lag_kept = lag_left(c, step);
    }

    // What has failed in a step is broken from its end on.
    void break_bonds() {
        int breaks = 0;
        for (const Column& sums : column) breaks += sums.breaks;
        if (breaks == 0) return;
        broken += breaks;
        for (auto& axis : bonds)
            for (Bond& bond : axis)
                if (bond.break_time == BREAKING) bond.break_time = time;
    }

    bool whole(int axis, int k) const { return bonds[axis][k].break_time == INTACT; }

    // Between two steps: cells let go as cracks pull them apart. What they hold only falls.
    void look_column(int i) {
        if (i == columns - 1) return;
        for (int j = 0; j < rows - 1; ++j) {
            const int k = at(i, j), right = k + stride, up = k + 1;
            const bool below = whole(A, k), above = whole(A, up);
            const bool before = whole(B, k), after = whole(B, right);
            if (below && above && before && after) continue;
            Cell& cell = cells[k];
            cell.hold = hold_left(c, apart(k, right + 1), apart(right, up), cell.hold);
            // it hangs together by one of its two sides along each axis
            cell.grip = (below || above) && (before || after) ? cell.hold : Real(0.0);
        }
    }

    // Gather the forces on a column's nodes, and take the stage. The friction springs are latched
    // at the first stage, whose `rate` still holds the last step's motion.
    void node_column(int i, int stage) {
        const Constants c = this->c;
        const Real weight = stage_weight(stage, step), ahead = stage_ahead(stage, step);
        const Real per_mass = 1.0 / c.node_mass;
        const Real body_path = stage > 0 ? body.trial_y - body.y : body.rate_y;
        Column sums = column[i];
        Real power[WORKS] = {};
        sums.lift = 0.0;
        sums.astray = false;
        for (int j = 0; j < rows; ++j) {
            const int k = at(i, j);
            const Node now = trial[k];
            const Vec right = forces[k].bond[A], left = forces[k - stride].bond[A];
            const Vec above = forces[k].bond[B], below = forces[k - 1].bond[B];
            // each of four cells has the node at another corner: its first, upper, far, right one
            const Vec first = forces[k].diagonal[0], upper = forces[k - 1].diagonal[1];
            const Vec far = forces[k - stride - 1].diagonal[0];
            const Vec across = forces[k - stride].diagonal[1];
            Vec force = {right.x - left.x + (above.x - below.x) + (upper.x - first.x) +
                             (far.x - across.x),
                         right.y - left.y + (above.y - below.y) + (upper.y - first.y) +
                             (far.y - across.y)};
            power[BONDS] -= force.x * now.vx + force.y * now.vy;
            const bool held = j == 0 && c.hold_y != 0.0;
            if (!held) {
                Vec path = {rate[k].x, rate[k].y};
                if (stage > 0) path = {now.x - state[k].x, now.y - state[k].y};
                const Vec relative = {now.vx, now.vy - body.trial_v};
                const Touch hit = impactor_contact(
                    c, edges.data(), int(edges.size()),
                    {now.x - c.impactor_x, now.y - body.trial_y}, relative,
                    {path.x, path.y - body_path}, impactor_slip[k]);
                const Touch floor = floor_contact(
                    c, now.y, min(bonds[A][k].worst, bonds[A][k - stride].worst),
                    min(bonds[B][k].worst, bonds[B][k - 1].worst), path.x, floor_slip[k]);
                if (stage == 0) {
                    impactor_slip[k] = hit.stretch;
                    floor_slip[k] = floor.stretch;
                }
                power[CONTACT] -= dot(hit.pressing, relative) + floor.pressing.y * now.vy;
                power[FRICTION] -= dot(hit.rubbing, relative) + floor.rubbing.x * now.vx;
                sums.lift -= hit.pressing.y + hit.rubbing.y;
                force.x += hit.pressing.x + hit.rubbing.x + floor.rubbing.x;
                force.y += hit.pressing.y + hit.rubbing.y + floor.pressing.y;
            }
            Node slope = {now.vx, now.vy, force.x * per_mass, force.y * per_mass - c.gravity};
            if (j == 0 && c.hold_x != 0.0) slope.vx = 0.0;
            if (held) slope.vy = 0.0;
            Node sum = {weight * slope.x, weight * slope.y, weight * slope.vx, weight * slope.vy};
            if (stage > 0) {
                sum = {sum.x + rate[k].x, sum.y + rate[k].y, sum.vx + rate[k].vx,
                       sum.vy + rate[k].vy};
            }
            rate[k] = sum;
            const Node& old = state[k];
            if (stage < LAST_STAGE) {
                trial[k] = {old.x + ahead * slope.x, old.y + ahead * slope.y,
                            old.vx + ahead * slope.vx, old.vy + ahead * slope.vy};
            } else {
                trial[k] = state[k] = {old.x + sum.x, old.y + sum.y, old.vx + sum.vx,
                                       old.vy + sum.vy};
                const Real total = abs(state[k].x) + abs(state[k].y) + abs(state[k].vx) +
                                   abs(state[k].vy);
                if (!(total < ASTRAY)) sums.astray = true;
            }
        }
        power[SHEAR] = sums.shear_power;
        power[DASHPOTS] = sums.dashpot_power;
        for (int k = 0; k < WORKS; ++k) sums.work[k] += weight * power[k];
        column[i] = sums;
    }
};

}  // namespace peer

PEER_INTERFACE(peer::Lattice)
