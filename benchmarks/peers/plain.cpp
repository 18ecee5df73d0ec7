// The lattice's Runge-Kutta step, plainly: a struct for each node, and two passes a stage. The
// first finds the forces of each node's two bonds, the second gathers four of them.
#include <vector>

#include "interface.hpp"
#include "model.hpp"

namespace peer {

struct Node {
    Real x, y, vx, vy;
};

struct Bond {
    Real ahead, behind;  // factors of the two halves in the gradient across the bond [1/m]
    Real worst;          // the most compressive strain so far
    Real break_time;
};

struct Faces {  // forces of a node's two bonds on it [N]
    Vec force[2];
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
          state(nodes()), trial(nodes()), rate(nodes()), faces(nodes()),
          bonds{std::vector<Bond>(nodes()), std::vector<Bond>(nodes())},
          impactor_slip(nodes()), floor_slip(nodes()), column(columns), body{} {
        for (int k = 0; k < edge_count; ++k)
            this->edges.push_back({edges[3 * k], edges[3 * k + 1], edges[3 * k + 2]});
        this->body.y = this->body.trial_y = body[0];
        this->body.v = this->body.trial_v = body[1];
        for (auto& axis : bonds) std::fill(axis.begin(), axis.end(), Bond{0.0, 0.0, 0.0, NEVER});
        for (int i = 0; i < columns; ++i)
            for (int j = 0; j < rows; ++j) {
                const double* from = start + 4 * (i * rows + j);
                trial[at(i, j)] = state[at(i, j)] = {from[0], from[1], from[2], from[3]};
                if (i < columns - 1) bonds[A][at(i, j)].break_time = INTACT;
                if (j < rows - 1) bonds[B][at(i, j)].break_time = INTACT;
            }
        for (int i = 0; i < columns; ++i) update_halves(i);
    }

    long advance(long steps, int threads) {
        for (long n = 0; n < steps; ++n) {
            take_stock();
            for (int stage = 0; stage <= LAST_STAGE; ++stage) {
                over_columns(columns, threads, [=](int i) { face_column(i, stage); });
                over_columns(columns, threads, [=](int i) { node_column(i, stage); });
                Real lift = 0.0;
                for (const Column& sums : column) lift += sums.lift;
                body_stage(c, body, stage, step, lift);
            }
            time += step;
            break_bonds();
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
    std::vector<Faces> faces;
    std::vector<Bond> bonds[2];
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

    // Force of a bond on its first node k. The first stage, whose state is the accepted one, brings
    // the worst strain up to date; the last, which looks at the step's end, finds what fails.
    template <int axis>
    Vec face_force(const Constants& c, int k, int stage, Column& sums) {
        const int along = axis == A ? stride : 1, side = axis == A ? 1 : stride;
        const int end = k + along;
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
        const Real pull = c.area[axis] * stress / length;
        Vec force = {pull * reach.x, pull * reach.y};
        if (!intact) return force;

        const Vec ahead_start = apart(k, k + side), ahead_end = apart(end, end + side);
        const Vec behind_start = apart(k - side, k), behind_end = apart(end - side, end);
        const Vec across = {bond.ahead * (ahead_start.x + ahead_end.x) +
                                bond.behind * (behind_start.x + behind_end.x),
                            bond.ahead * (ahead_start.y + ahead_end.y) +
                                bond.behind * (behind_start.y + behind_end.y)};
        const Real gamma = dot(reach, across) * c.per_length[axis];
        const Real tau = c.shear_modulus * gamma;
        const Vec shear = {c.area[axis] * tau * across.x, c.area[axis] * tau * across.y};
        const Vec relative = {trial[end].vx - trial[k].vx, trial[end].vy - trial[k].vy};
        Vec drag = {c.dashpot[axis] * relative.x, c.dashpot[axis] * relative.y};
        if (HAS_EXCESS) {
            const Real closing = c.excess[axis] * dot(reach, relative) / square;
            drag.x += closing * reach.x;
            drag.y += closing * reach.y;
        }
        force.x += shear.x + drag.x;
        force.y += shear.y + drag.y;
        sums.shear_power += dot(shear, relative);
        sums.dashpot_power += dot(drag, relative);
        if (stage == LAST_STAGE &&
            (fails_in_tension<axis>(c, k, e, HAS_RATE ? worst : min(worst, e)) ||
             fails_in_shear(c, e, yielding, tau))) {
            bond.break_time = BREAKING;
            sums.breaks += 1;
        }
        return force;
    }

    // Crush across a bond is that of the end which is crushed less.
    template <int axis>
    bool fails_in_tension(const Constants& c, int k, Real e, Real worst) const {
        if (e <= 0.0) return false;
        Real limit = tensile_limit(c, worst);
        if (HAS_WEAKENED) {
            const int end = k + (axis == A ? stride : 1), side = axis == A ? 1 : stride;
            const std::vector<Bond>& crossing = bonds[1 - axis];
            const Real near = min(crossing[k].worst, crossing[k - side].worst);
            const Real far = min(crossing[end].worst, crossing[end - side].worst);
            limit = limit * strength_left(c, max(near, far));
        }
        return e > limit;
    }

    void face_column(int i, int stage) {
        const Constants c = this->c;
        Column sums = column[i];
        sums.densified = 0.0;
        sums.shear_power = sums.dashpot_power = 0.0;
        sums.breaks = 0;
        for (int j = 0; j < rows; ++j) {
            const int k = at(i, j);
            if (i < columns - 1) faces[k].force[A] = face_force<A>(c, k, stage, sums);
            if (j < rows - 1) faces[k].force[B] = face_force<B>(c, k, stage, sums);
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
        for (int i = 0; i < columns; ++i) update_halves(i);
    }

    bool whole(int axis, int k) const { return bonds[axis][k].break_time == INTACT; }

    void update_halves(int i) {
        for (int j = 0; j < rows; ++j) {
            const int k = at(i, j), right = k + stride, up = k + 1, left = k - stride;
            const bool above = half_counts(c, whole(B, k), whole(B, right));
            const bool below = half_counts(c, whole(B, k - 1), whole(B, right - 1));
            const bool after = half_counts(c, whole(A, k), whole(A, up));
            const bool before = half_counts(c, whole(A, left), whole(A, left + 1));
            const Halves a = halves(above, below, c.per_length[B]);
            const Halves b = halves(after, before, c.per_length[A]);
            bonds[A][k].ahead = a.ahead, bonds[A][k].behind = a.behind;
            bonds[B][k].ahead = b.ahead, bonds[B][k].behind = b.behind;
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
            const Vec right = faces[k].force[A], left = faces[k - stride].force[A];
            const Vec above = faces[k].force[B], below = faces[k - 1].force[B];
            Vec force = {right.x - left.x + (above.x - below.x),
                         right.y - left.y + (above.y - below.y)};
            power[FACES] -= force.x * now.vx + force.y * now.vy;
            const bool held = j == 0 && c.hold_y != 0.0;
            if (!held) {
                Vec path = {rate[k].x, rate[k].y};
                if (stage > 0) path = {now.x - state[k].x, now.y - state[k].y};
                const Touch hit = impactor_contact(
                    c, edges.data(), int(edges.size()),
                    {now.x - c.impactor_x, now.y - body.trial_y}, {path.x, path.y - body_path},
                    impactor_slip[k]);
                const Touch floor = floor_contact(
                    c, now.y, min(bonds[A][k].worst, bonds[A][k - stride].worst),
                    min(bonds[B][k].worst, bonds[B][k - 1].worst), path.x, floor_slip[k]);
                if (stage == 0) {
                    impactor_slip[k] = hit.stretch;
                    floor_slip[k] = floor.stretch;
                }
                const Vec relative = {now.vx, now.vy - body.trial_v};
                power[IMPACTOR] -= dot(hit.pressing, relative);
                power[FRICTION] -= dot(hit.rubbing, relative);
                power[BASE] -= floor.pressing.x * now.vx + floor.pressing.y * now.vy;
                sums.lift -= hit.pressing.y + hit.rubbing.y;
                force.x += hit.pressing.x + hit.rubbing.x + floor.pressing.x;
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
        // sampled at both ends of the step: the trapezium rule
        const Real sampled = stage == 0 || stage == LAST_STAGE ? 3.0 : 0.0;
        power[SHEAR] = sampled * sums.shear_power;
        power[DASHPOTS] = sampled * sums.dashpot_power;
        for (int k = 0; k < WORKS; ++k) sums.work[k] += weight * power[k];
        column[i] = sums;
    }
};

}  // namespace peer

PEER_INTERFACE(peer::Lattice)
