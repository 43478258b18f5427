#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "fixed_point.hpp"
#include "gauss_rule.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/model/taper.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/unloaded_change.hpp"
#include "lie/jacobian_slope.hpp"
#include "linear_chain.hpp"
#include "shape_motion.hpp"

namespace helix_arm::statics {

/// Number of Gauss points of an element: of the lowest order, and of the reference solution for
/// checks.
inline constexpr int kLeastNodes = kLeastOrder + 1;
inline constexpr int kFineNodes = GaussRule::kMostNodes;

// Tolerances of the loaded tier.

inline constexpr int kMaxIterations = 100;
// Largest change at convergence, relative to the arm's size and one radian.
inline constexpr double kAtRest = 1e-11;
// The step of the lowest order is accepted if the next step would be shorter by this factor and at
// most this long, relative to the arm's size and one radian.
inline constexpr double kContracting = 0.5;
inline constexpr double kTrustedStep = 0.02;
// Rotation of a section from its unloaded shape beyond which its coordinates are ambiguous [rad].
inline constexpr double kFarthestTurn = 5.5;
inline constexpr double kFarthestResidual = 1e6;
// Difference step of the iteration's derivative, relative to the arm's size and one radian.
inline constexpr double kResponseStep = 1e-6;
inline constexpr double kNoWork = 1e-9;  // work of a wrench on a null space, relative to the load's

// Part of the order's stated error beyond which a shape is compared with a finer solution.
inline constexpr double kDoubt = 0.25;
// Limit of the rates in the highest mode, relative to the arm's size and one radian.
inline constexpr double kLargestTail = 0.065;
// Turn of an element that is not resolved at all [rad]: per Gauss point, and as a whole for the
// less accurate single step.
inline constexpr double kTurnOfNode = 3.0;
inline constexpr double kTurnOfOneStep = 20.0;
// Largest turn that this resolves [rad], and the permitted difference as part of the stated error.
inline constexpr double kFinestTurn = 40.0;
inline constexpr double kAgreement = 0.7;
inline constexpr double kLargestAmplification = 1.0 - 1e-9;

// Stiffness of a shape that may have another beside it: 2 a = turn^2 / 4 [rad], as much to spare.
inline constexpr double kBranching = 0.5;
// Load steps, relative to the whole load.
inline constexpr double kFirstLoadStep = 0.25;
inline constexpr double kLeastLoadStep = 1e-3;
// Distance of a step's shape from the predicted one: relative to the step, or to the arm's size and
// 1 rad.
inline constexpr double kOnBranch = 0.5;
inline constexpr double kNearBranch = 0.05;

/// The elements of an unloaded arm: poses seen from their starts, compliance at the Gauss points.
template <class Group>
class LoadedArmOf<Group>::UnloadedElements {
 public:
  using Tangent = typename Group::Tangent;
  using Matrix = typename Group::Matrix;
  using Motion = typename UnloadedChange<Group>::Motion;

  /// Keeps references to the arm and to the unloaded state.
  UnloadedElements(const LoadedArmOf& arm, const Unloaded& unloaded, const GaussRule& rule)
      : arm_(arm), unloaded_(unloaded), rule_(rule), nodes_(rule.count()) {
    const int count = static_cast<int>(arm.elements_.size());
    if (arm.tapered_ || arm.has_tables_) compliance_.resize(nodes_ * count);
    for (int e = 0; e < count; ++e) {
      const Element& element = arm.elements_[e];
      if (arm.tapers_[element.section]) {
        addTapered(e);
        continue;
      }
      twist_[e] = element.length * unloaded.twists.col(element.section);
      for (int j = 0; j < nodes_; ++j) {
        const Group X = Group::exp(rule_.nodes()[j] * twist_[e]);
        rotation_[e * nodes_ + j] = X.rotation;
        translation_[e * nodes_ + j] = X.translation;
        if (compliance_.empty()) continue;
        compliance_[e * nodes_ + j] =
            arm.has_tables_ ? Matrix(unloaded.compliance.template middleCols<Group::kDof>(
                                  Group::kDof * element.section))
                            : arm.compliance_[element.section];
      }
    }
  }

  /// Twist over element e; of a tapered one, the sum of its steps.
  const Tangent& twist(int e) const { return twist_[e]; }
  Group atNode(int node) const { return {rotation_[node], translation_[node]}; }
  Group end(int e) const { return isTapered(e) ? end_[e] : Group::exp(twist_[e]); }
  /// At t in [0, 1] of element e.
  Group at(int e, double t) const {
    if (!isTapered(e)) return Group::exp(t * twist_[e]);
    const Element& element = arm_.elements_[e];
    const int before = nodesBefore(t);
    return (before > 0 ? atNode(e * nodes_ + before - 1) : Group()) *
           Group::exp(profileOf(element.section)
                          .step(element.begin + lastNode(before) * element.length,
                                element.begin + t * element.length));
  }
  /// Motions (dof x m) of nodes and end by the section's parameters, seen from the element's start.
  std::vector<Motion> changes(int e, const UnloadedChange<Group>& change) const {
    std::vector<Motion> out;
    for (int j = 0; j <= nodes_; ++j) {
      out.push_back(changeAt(e, j < nodes_ ? rule_.nodes()[j] : 1.0, j, change, out));
    }
    return out;
  }
  /// The same at t in [0, 1], from changes().
  Motion changeAt(int e, double t, const UnloadedChange<Group>& change,
                  const std::vector<Motion>& at_nodes) const {
    return changeAt(e, t, nodesBefore(t), change, at_nodes);
  }

  /// Twist per wrench, both seen from the node's frame.
  const Matrix& compliance(int e, int j) const {
    if (!compliance_.empty()) return compliance_[e * nodes_ + j];
    return arm_.compliance_[arm_.elements_[e].section];
  }

 private:
  bool isTapered(int e) const {
    return arm_.tapered_ && arm_.tapers_[arm_.elements_[e].section] != nullptr;
  }

  model::TaperTwist<Group> profileOf(int section) const {
    const int first = arm_.first_[section];
    return {*arm_.tapers_[section],
            unloaded_.lengths.segment(first, arm_.first_[section + 1] - first)};
  }

  int nodesBefore(double t) const { return static_cast<int>((rule_.nodes().array() <= t).count()); }
  // The last of so many, from the element's start.
  double lastNode(int before) const { return before > 0 ? rule_.nodes()[before - 1] : 0.0; }

  // At t, with `before` nodes before it.
  Motion changeAt(int e, double t, int before, const UnloadedChange<Group>& change,
                  const std::vector<Motion>& at_nodes) const {
    const Element& element = arm_.elements_[e];
    if (!isTapered(e)) {
      return Group::leftJacobian(t * twist_[e]) *
             (t * element.length * change.twist(element.section, 0.0));
    }
    const TaperStep<Group> step = taperStep(profileOf(element.section), change, element.section,
                                            element.begin + lastNode(before) * element.length,
                                            element.begin + t * element.length);
    const Motion moved = Group::leftJacobian(step.twist) * step.by;
    if (before == 0) return moved;
    return at_nodes[before - 1] + atNode(e * nodes_ + before - 1).adjoint() * moved;
  }

  // Magnus steps from Gauss point to Gauss point.
  void addTapered(int e) {
    const Element& element = arm_.elements_[e];
    const model::TaperTwist<Group> profile = profileOf(element.section);
    Group X;
    double from = element.begin;
    twist_[e].setZero();
    for (int j = 0; j <= nodes_; ++j) {
      const double to = element.begin + (j < nodes_ ? rule_.nodes()[j] : 1.0) * element.length;
      const Tangent step = profile.step(from, to);
      twist_[e] += step;
      X = X * Group::exp(step);
      from = to;
      if (j == nodes_) break;
      rotation_[e * nodes_ + j] = X.rotation;
      translation_[e * nodes_ + j] = X.translation;
      compliance_[e * nodes_ + j] =
          arm_.per_K_[element.section] * arm_.tapers_[element.section]->complianceAt(to);
    }
    end_[e] = X;
  }

  const LoadedArmOf& arm_;
  const Unloaded& unloaded_;
  const GaussRule& rule_;
  int nodes_;  // per element
  Tangent twist_[kMaxElements];
  decltype(Group::rotation) rotation_[kMaxNodes];
  typename Group::Point translation_[kMaxNodes];
  Group end_[kMaxElements];         // of tapered elements
  std::vector<Matrix> compliance_;  // at the nodes, if it is not one constant per section
};

/// A parameter that changes no section: the column of a residual.
template <class Group>
class NoChange final : public UnloadedChange<Group> {
 public:
  using typename UnloadedChange<Group>::Motion;
  using typename UnloadedChange<Group>::Tangent;
  int count() const override { return 1; }
  int first(int /*k*/) const override { return 0; }
  int columns(int /*k*/) const override { return 1; }
  Motion twist(int /*k*/, double /*s*/) const override { return Motion::Zero(Group::kDof, 1); }
  Motion strain(int /*k*/, double /*s*/, const Tangent& /*strain*/) const override {
    return Motion::Zero(Group::kDof, 1);
  }
};

/// One solution of the loaded tier, with one number of Gauss points in all elements. All data is on
/// the stack, in arrays of the maximum size of which only what is used is set.
template <class Group>
class LoadedArmOf<Group>::Relaxation {
 public:
  static constexpr int kDof = Group::kDof;
  using Tangent = typename Group::Tangent;
  using Point = typename Group::Point;
  using Rates = Eigen::Matrix<double, kDof, Eigen::Dynamic, Eigen::ColMajor, kDof, kMaxNodes>;

  Relaxation(const LoadedArmOf& arm, const Unloaded& unloaded, int nodes)
      : arm_(arm),
        load_(arm.load_),
        rule_(GaussRule::of(nodes)),
        nodes_(nodes),
        count_(elementCount(arm)),
        unloaded_(arm, unloaded, rule_) {
    scale_ << Eigen::Matrix<double, Group::kSpace, 1>::Constant(1.0 / arm.size_),
        Eigen::Matrix<double, Group::kRotations, 1>::Ones();
    rates_.setZero(kDof, nodes_ * count_);
    at_.resize(Group::kSpace, nodes_ * count_);
  }

  // Starts at another solution.
  void startFrom(const Relaxation& other) {
    if (nodes_ == other.nodes_) {
      rates_ = other.rates_;
      return;
    }
    for (int node = 0; node < rates_.cols(); ++node) {
      rates_.col(node) = other.sum(node / nodes_, other.rule_.at(rule_.nodes()[node % nodes_]));
    }
  }

  // Out of line, since it is long and has many callers.
  [[gnu::noinline]] void run(bool one_step) {
    if (one_step) {
      takeOneStep();
    } else {
      iterate();
    }
    if (status_ == SolveStatus::kConverged && !supported()) status_ = SolveStatus::kUnsupported;
    if (!tip_.translation.allFinite()) status_ = SolveStatus::kNotConverged;
  }

  // Marks an unstable equilibrium as not converged. For stability, a change of strain must change
  // the load's strain by less than itself.
  void refuseUnstable() {
    if (status_ != SolveStatus::kConverged) return;
    const KrylovSpace::Range amplification = amplifications();
    if (!(amplification.largest <= 1.0)) status_ = SolveStatus::kNotConverged;
    amplification_ = std::clamp(amplification.largest, 0.0, kLargestAmplification);
    stiffening_ = std::max(-amplification.least, 0.0);
  }

  // Whether the shape may lie on another branch than the one that grows from the unloaded shape.
  // Where a motion x has another stable shape beside it, as in a buckled column (stiffness 1 -
  // amplification = 3 a x^2 - e, with a = 1/8 in Euler's), that stiffness is at most 2 a x^2.
  bool branches() const {
    if (status_ != SolveStatus::kConverged) return false;
    double turned = 0.0;
    for (int e = 0; e < count_; ++e) {
      turned += sum(e, rule_.weights()).template tail<Group::kRotations>().norm();
    }
    return 1.0 - amplification_ <= kBranching * turned * turned;
  }

  // Whether the tip error may exceed the stated one. The limits are from comparisons with finer
  // solutions under loads of all kinds.
  bool doubtful(double stated) const {
    if (status_ != SolveStatus::kConverged) return false;
    const double tail = highestMode();
    return !(tail <= kLargestTail && tipErrorBound(tail) <= kDoubt * stated);
  }

  // Compares with a solution that is finer, or on the branch of the unloaded shape, as truth.
  void compareWith(const TipOf<Group>& finer, double stated) {
    const double off = (finer.tip.translation - tip_.translation).norm() / arm_.size_;
    const bool resolved = turn() <= kFinestTurn;
    load_steps_ += finer.load_steps;
    if (finer.converged() && resolved && off <= kAgreement * stated) return;
    status_ = SolveStatus::kNotConverged;
    residual_ = std::max(residual_, off);
  }

  // Applies the load in steps along the branch that grows from the unloaded shape. Where steps
  // leave it however short they are, the shape does not count as converged.
  [[gnu::noinline]] void stepLoad() {
    Rates here = rates_, slope, predicted;
    here.setZero();
    rates_.setZero();
    evaluate(slope);  // of the branch where it begins, since the wrench is that of no load
    double reached = 0.0, step = kFirstLoadStep;
    while (reached < 1.0) {
      share_ = std::min(reached + step, 1.0);
      rates_ = predicted = here + (share_ - reached) * slope;
      iterate();
      const double off = largest(rates_ - predicted), moved = largest(predicted - here);
      if (status_ == SolveStatus::kConverged && off <= std::max(kOnBranch * moved, kNearBranch)) {
        slope = (rates_ - here) / (share_ - reached);
        here = rates_;
        reached = share_;
        ++load_steps_;
        if (off <= kNearBranch) step *= 2.0;
        continue;
      }
      step = 0.5 * (share_ - reached);
      status_ = SolveStatus::kNotConverged;
      if (step < kLeastLoadStep) break;
    }
    share_ = 1.0;
  }

  // Newton's step, which leaves only rounding errors.
  void polish() {
    if (nodes_ == kLeastNodes) return;  // its result is no fixed point
    Rates answer;
    evaluate(answer);
    const NoChange<Group> none;
    std::vector<LinearElement<Group>> elements = linearised(none);
    for (int node = 0; node < rates_.cols(); ++node) {
      elements[node / nodes_].nodes[node % nodes_].rate = answer.col(node) - rates_.col(node);
    }
    const auto step =
        LinearChain<Group>(elements).balanced(wrenchesAt<Group>(tip_.translation, 1, false));
    for (int e = 0; e < count_; ++e) {
      rates_.middleCols(e * nodes_, nodes_) += step.rates[e].reshaped(kDof, nodes_);
    }
    place();
  }

  // Motions of the elements' starts and of the tip by the change's parameters and, in six more
  // columns on request, by a force and a moment at the tip.
  typename LinearChain<Group>::Response respond(const UnloadedChange<Group>& change, bool by_load) {
    if (nodes_ == kLeastNodes) return respondToOneStep(change, by_load);
    Rates answer;
    evaluate(answer);
    return LinearChain<Group>(linearised(change))
        .balanced(wrenchesAt<Group>(tip_.translation, change.count(), by_load));
  }

  // Motions of the ends of the shape's pieces.
  std::vector<Eigen::Matrix<double, 6, Eigen::Dynamic>> pieceMotions(
      int sections, const UnloadedChange<Group>& change,
      const typename LinearChain<Group>::Response& response) const {
    using Motion = typename LinearChain<Group>::Motion;
    std::vector<Eigen::Matrix<double, 6, Eigen::Dynamic>> out;
    std::vector<Motion> unloaded;
    Place place{*this};
    int of = -1;  // the element of `unloaded`
    for (int piece = 0; piece < sections * kLoadedPieces; ++piece) {
      const double t = place.go(piece / kLoadedPieces,
                                static_cast<double>(piece % kLoadedPieces + 1) / kLoadedPieces);
      const int e = place.e, section = arm_.elements_[e].section;
      if (of != e) unloaded = unloaded_.changes(e, change);
      of = e;
      const GaussRule::Vector weights = rule_.upTo(t);
      const Tangent z = sum(e, weights);
      Motion by_z = Motion::Zero(kDof, response.starts[e].cols());
      for (int l = 0; l < nodes_; ++l) {
        by_z += weights[l] * response.rates[e].template middleRows<kDof>(kDof * l);
      }
      Motion motion = response.starts[e] + start_[e].adjoint() * Group::leftJacobian(z) * by_z;
      motion.middleCols(change.first(section), change.columns(section)) +=
          (start_[e] * Group::exp(z)).adjoint() * unloaded_.changeAt(e, t, change, unloaded);
      out.push_back(motionsInSpace(motion));
    }
    return out;
  }

  TipOf<Group> result() const { return {tip_, status_, residual_, iterations_, load_steps_}; }
  Solution solution(int sections) const { return {inSpace(result()), shape(sections)}; }

  // Pose at t in [0, 1] of an element, seen from the base.
  Group poseAt(int e, double t) const {
    const Tangent z = sum(e, rule_.upTo(t));
    return start_[e] * Group::exp(z) * unloaded_.at(e, t);
  }

  model::Shape shape(int sections) const {
    model::Shape::Pieces pieces(6, sections * kLoadedPieces);
    lie::SE3 before;
    Place place{*this};
    for (int piece = 0; piece < pieces.cols(); ++piece) {
      const lie::SE3 X = place.at(piece / kLoadedPieces,
                                  static_cast<double>(piece % kLoadedPieces + 1) / kLoadedPieces);
      const Eigen::Vector3d turn = lie::inSpace(unloaded_.twist(place.e)).template tail<3>() /
                                   arm_.elements_[place.e].length;
      pieces.col(piece) = twistNear(before.inverse() * X, turn / kLoadedPieces);
      before = X;
      if (arm_.links_in_space_ && (piece + 1) % kLoadedPieces == 0) {
        before = before * (*arm_.links_in_space_)[piece / kLoadedPieces];
      }
    }
    return {pieces, kLoadedPieces, arm_.links_in_space_};
  }

  // The curve at evenly spaced s, including base and tip.
  std::vector<model::CurvePoint<lie::SE3>> curve(int sections, int count) const {
    std::vector<model::CurvePoint<lie::SE3>> out;
    out.reserve(count);
    Place place{*this};
    for (int i = 0; i < count; ++i) {
      const double s = model::curvePlace(sections, i, count);
      const int k = std::min(static_cast<int>(s), sections - 1);
      out.push_back({s, place.at(k, s - k)});
    }
    return out;
  }

 private:
  // Poses in sequence along the arm, from base to tip.
  struct Place {
    const Relaxation& shape;
    int e = 0;

    // Goes to s of section k, at or beyond the previous place; its t in [0, 1] of element e.
    double go(int k, double s) {
      const auto& elements = shape.arm_.elements_;
      while (e + 1 < shape.count_ &&
             (elements[e].section < k || elements[e].begin + elements[e].length < s)) {
        ++e;
      }
      const Element& element = elements[e];
      return std::min((s - element.begin) / element.length, 1.0);
    }
    // Pose there.
    lie::SE3 at(int k, double s) {
      const double t = go(k, s);
      return lie::inSpace(shape.poseAt(e, t));
    }
  };

  static int elementCount(const LoadedArmOf& arm) { return static_cast<int>(arm.elements_.size()); }

  // Sum of an element's columns, one per Gauss point, with these weights. In loops, since Eigen's
  // products of run-time size are slow where they are this small.
  template <class Columns, class Weights>
  auto sumOf(const Columns& columns, int e, const Weights& weights) const {
    Eigen::Matrix<double, Columns::RowsAtCompileTime, 1> out = weights[0] * columns.col(e * nodes_);
    for (int l = 1; l < nodes_; ++l) out += weights[l] * columns.col(e * nodes_ + l);
    return out;
  }
  template <class Weights>
  Tangent sum(int e, const Weights& weights) const {
    return sumOf(rates_, e, weights);
  }

  Group poseOf(int node) const { return {at_rotation_[node], at_.col(node)}; }

  // Rates that balance the load on the shape of rates_; sets start_ and tip_ for that shape.
  [[gnu::noinline]] void evaluate(Rates& out) {
    out.resize(kDof, rates_.cols());
    Group X;
    farthest_ = 0.0;
    for (int e = 0; e < count_; ++e) {
      start_[e] = X;
      for (int j = 0; j < nodes_; ++j) {
        const int node = e * nodes_ + j;
        const Tangent z = sum(e, rule_.before().col(j));
        const Group X_j = X * Group::exp(z) * unloaded_.atNode(node);
        at_rotation_[node] = X_j.rotation;
        at_.col(node) = X_j.translation;
        z_[node] = z;
        farthest_ = std::max(farthest_, z.template tail<Group::kRotations>().norm());
      }
      X = X * Group::exp(sum(e, rule_.weights())) * unloaded_.end(e);
      if (arm_.elements_[e].linked) X = X * linkAfter(e);
    }
    tip_ = X;

    Tangent W = Tangent::Zero();  // of all loads beyond, about the base's origin
    for (int e = count_ - 1; e >= 0; --e) {
      const Element& element = arm_.elements_[e];
      const Group& next = e + 1 < count_ ? start_[e + 1] : tip_;
      const Group end = element.linked ? next * linkAfter(e).inverse() : next;
      for (const int p : element.points) {
        const PointLoad& point = load_.points[p];
        const Point force = within<Group>(load_.forceOf(point));
        add(force,
            momentOf(end * within<Group>(point.offset), force) + turningWithin<Group>(point.moment),
            W);
      }
      const Point weight =
          within<Group>(element.length * load_.mass[element.section] * load_.gravity);
      const double stretch = share_ * element.length;
      for (int j = 0; j < nodes_; ++j) {
        const int node = e * nodes_ + j;
        Tangent W_j = W;
        add((1.0 - rule_.nodes()[j]) * weight,
            momentOf(sumOf(at_, e, rule_.after().col(j)), weight), W_j);
        wrench_[node] = seenFrom<Group>(poseOf(node), W_j);
        const Tangent strain = stretch * (unloaded_.compliance(e, j) * wrench_[node]);
        out.col(node) = Group::solveRightJacobian(z_[node], moved(unloaded_.atNode(node), strain));
      }
      add(weight, momentOf(sumOf(at_, e, rule_.weights()), weight), W);
    }
    pull_ = W.template head<Group::kSpace>().norm() * arm_.size_ +
            W.template tail<Group::kRotations>().norm();
  }

  // The fixed point's derivatives at the last evaluated shape.
  std::vector<LinearElement<Group>> linearised(const UnloadedChange<Group>& change) const {
    std::vector<LinearElement<Group>> out;
    for (int e = 0; e < count_; ++e) out.push_back(linearised(e, change));
    return out;
  }

  LinearElement<Group> linearised(int e, const UnloadedChange<Group>& change) const {
    using Matrix = typename Group::Matrix;
    using Motion = typename LinearChain<Group>::Motion;
    const Element& element = arm_.elements_[e];
    const Group& start = start_[e];
    const std::vector<Motion> unloaded = unloaded_.changes(e, change);
    LinearElement<Group> out;
    out.before = rule_.before();
    out.after = rule_.after();
    out.weights = rule_.weights();
    out.first_column = change.first(element.section);
    for (int j = 0; j < nodes_; ++j) {
      const int node = e * nodes_ + j;
      const Tangent& z = z_[node];
      const Matrix Ad_unloaded = unloaded_.atNode(node).adjoint();
      const Matrix& C = unloaded_.compliance(e, j);
      const Matrix Jr_inverse = Group::rightJacobianInverse(z);
      const Tangent strain = C * wrench_[node];
      const Tangent moved_strain = element.length * (Ad_unloaded * strain);
      LinearNode<Group> linear;
      linear.X = poseOf(node);
      linear.wrench = wrench_[node];
      linear.motion_by_z = start.adjoint() * Group::leftJacobian(z);
      linear.motion = (start * Group::exp(z)).adjoint() * unloaded[j];
      linear.rate_by_wrench = element.length * (Jr_inverse * Ad_unloaded * C);
      linear.rate_by_z = lie::solvedRightJacobianSlope(z, moved_strain);
      const double s = element.begin + rule_.nodes()[j] * element.length;
      Motion rate = element.length * (Ad_unloaded * change.strain(element.section, s, strain));
      for (int i = 0; i < rate.cols(); ++i) {
        rate.col(i) += model::bracket(Tangent(unloaded[j].col(i)), moved_strain);
      }
      linear.rate = Jr_inverse * rate;
      out.nodes.push_back(std::move(linear));
    }
    const Tangent z = sum(e, rule_.weights());
    const Group before_unloaded = start * Group::exp(z);
    out.end_by_z = start.adjoint() * Group::leftJacobian(z);
    out.end = before_unloaded.adjoint() * unloaded[nodes_];
    out.weight = within<Group>(element.length * load_.mass[element.section] * load_.gravity);
    const Group end = before_unloaded * unloaded_.end(e);
    for (const int p : element.points) {
      const PointLoad& point = load_.points[p];
      out.pulls.push_back({end * within<Group>(point.offset), within<Group>(load_.forceOf(point))});
    }
    return out;
  }

  // The derivative of takeOneStep().
  typename LinearChain<Group>::Response respondToOneStep(const UnloadedChange<Group>& change,
                                                         bool by_load) {
    using Matrices = std::vector<Eigen::MatrixXd>;
    const Eigen::Index columns =
        wrenchesAt<Group>(tip_.translation, change.count(), by_load).cols();
    const auto answerTo = [&](const Matrices& rates) {
      return LinearChain<Group>(linearised(change))
          .answer(rates, wrenchesAt<Group>(tip_.translation, change.count(), by_load));
    };
    const Rates found = rates_;
    Rates first, second;
    rates_.setZero();
    evaluate(first);
    const Matrices by_first = answerTo(Matrices(static_cast<std::size_t>(count_),
                                                Eigen::MatrixXd::Zero(kDof * nodes_, columns)))
                                  .rates;
    rates_ = first;
    evaluate(second);
    const Matrices by_second = answerTo(by_first).rates;
    // factor = first . (second - first) / |first|^2
    const Rates step = second - first;
    const auto weighted = [this](const Rates& rates) -> Rates {
      return scale_.cwiseAbs2().asDiagonal() * rates;
    };
    const Rates first_w = weighted(first), step_w = weighted(step);
    const double square = first.cwiseProduct(first_w).sum();
    const double factor = square > 0 ? first.cwiseProduct(step_w).sum() / square : 0.0;
    const auto at = [this](const Rates& rates, int e) -> Eigen::VectorXd {
      return rates.middleCols(e * nodes_, nodes_).reshaped();
    };
    Eigen::RowVectorXd by_factor = Eigen::RowVectorXd::Zero(columns);
    for (int e = 0; e < count_ && square > 0; ++e) {
      by_factor +=
          (at(step_w, e) - 2.0 * factor * at(first_w, e)).transpose() * by_first[e] / square;
      by_factor += at(first_w, e).transpose() * (by_second[e] - by_first[e]) / square;
    }
    Matrices by_found;
    for (int e = 0; e < count_; ++e) {
      by_found.push_back(by_second[e] + factor / (1.0 - factor) * (by_second[e] - by_first[e]) +
                         at(step, e) * by_factor / ((1.0 - factor) * (1.0 - factor)));
    }
    rates_ = found;
    evaluate(second);
    typename LinearChain<Group>::Response out = answerTo(by_found);
    out.rates = by_found;
    return out;
  }

  const Group& linkAfter(int e) const { return (*arm_.links_)[arm_.elements_[e].section]; }

  static void add(const Point& force, const Moment<Group>& moment, Tangent& W) {
    W.template head<Group::kSpace>() += force;
    W.template tail<Group::kRotations>() += moment;
  }

  void finish(SolveStatus status) {
    status_ = farthest_ < kFarthestTurn ? status : SolveStatus::kNotConverged;
  }

  // One step from the unloaded shape and a second one from the result. The remaining steps are
  // extrapolated from these two (Aitken: each step is the previous one times a constant factor).
  void takeOneStep() {
    Rates next;
    evaluate(next);
    const Rates first = next;
    rates_ = first;
    evaluate(next);
    iterations_ = 2;
    const Rates one = scale_.asDiagonal() * first, step = scale_.asDiagonal() * (next - first);
    const auto turnOf = [](const Rates& rates) {
      return rates.template bottomRows<Group::kRotations>().norm();
    };
    const double first_square = one.squaredNorm(), first_turn = turnOf(one);
    residual_ = step.norm();
    const double factor = first_square > 0 ? one.cwiseProduct(step).sum() / first_square : 0.0;
    rates_ = next;
    rates_ += factor / (1.0 - factor) * (next - first);
    place();
    const double shorter = first_square > 0 ? residual_ / std::sqrt(first_square) : 0.0;
    // Considers rotations separately, too: a load along the arm shortens it by more than it bends
    // it, and the shortening is the same in every step.
    factor_ = std::max(shorter, first_turn > 0 ? turnOf(step) / first_turn : 0.0);
    const bool contracts = shorter <= kContracting && shorter * residual_ <= kTrustedStep;
    finish(contracts ? SolveStatus::kConverged : SolveStatus::kNotConverged);
  }

  // Rates in the highest mode of all elements, t.
  double highestMode() const {
    double out = 0.0;
    for (int e = 0; e < count_; ++e) {
      out += scale_.cwiseProduct(sum(e, rule_.highest())).norm();
    }
    return out;
  }

  // Bound of the tip error, relative to the arm's size, by the modes that are omitted:
  //     t min(1, theta / theta_n)^n / (1 - a) + remainder(),
  // where the highest of n modes has rates t, of which that power is what moves the tip: elements
  // turn by up to theta, and n Gauss points resolve turns up to theta_n. a: amplification.
  double tipErrorBound(double tail) const {
    const double turned = turn();
    const double resolved = nodes_ == kLeastNodes ? kTurnOfOneStep : kTurnOfNode * nodes_;
    double seen = 1.0;
    for (int i = 0; i < nodes_ && turned < resolved; ++i) seen *= turned / resolved;
    return tail * seen / (1.0 - amplification_) + remainder();
  }

  // Upper bound of the largest turn of an element, including that due to the load [rad].
  double turn() const {
    double largest = 0.0;
    for (int e = 0; e < count_; ++e) {
      largest = std::max(largest, unloaded_.twist(e).template tail<Group::kRotations>().norm());
    }
    return largest + farthest_;
  }

  // Contribution of the steps that the lowest order omits, each the last one times the same factor;
  // 0 for the other orders, which take all steps. Where the load stiffens, as where it hangs, that
  // factor is negative; a stretch or torsion that is the same in every step hides it in factor_.
  double remainder() const {
    const double factor = std::min(std::max(factor_, amplification_), kLargestAmplification);
    const double hidden = stiffening_ / (1.0 + stiffening_);
    return nodes_ == kLeastNodes ? residual_ * std::max(factor / (1.0 - factor), hidden) : 0.0;
  }

  // Sets the starts of the elements and the tip for the shape of rates_.
  void place() {
    Group X;
    for (int e = 0; e < count_; ++e) {
      start_[e] = X;
      X = X * Group::exp(sum(e, rule_.weights())) * unloaded_.end(e);
      if (arm_.elements_[e].linked) X = X * linkAfter(e);
    }
    tip_ = X;
  }

  void iterate() {
    Rates answer;
    Rates weight = scale_.replicate(1, rates_.cols());
    Anderson anderson(flat(weight));
    for (iterations_ = 1; iterations_ <= kMaxIterations; ++iterations_) {
      evaluate(answer);
      residual_ = anderson.advance(flat(rates_), flat(answer));
      if (residual_ <= kAtRest) {
        rates_ = answer;
        place();
        return finish(SolveStatus::kConverged);
      }
      if (!(residual_ < kFarthestResidual)) break;
    }
    iterations_ = std::min(iterations_, kMaxIterations);
    place();
    finish(SolveStatus::kNotConverged);
  }

  // Largest change of all elements together, relative to the arm's size and one radian.
  double largest(const Rates& change) const {
    return count_ * (scale_.asDiagonal() * change).colwise().norm().maxCoeff();
  }

  static Eigen::Map<Eigen::VectorXd> flat(Rates& rates) { return {rates.data(), rates.size()}; }

  // Factors by which the load's response amplifies changes of strain: the eigenvalues of the
  // iteration's derivative, in a Krylov space (Arnoldi).
  [[gnu::noinline]] KrylovSpace::Range amplifications() {
    Rates found = rates_, weight = scale_.replicate(1, rates_.cols()), answer, moved;
    evaluate(answer);
    KrylovSpace space(static_cast<int>(found.size()));
    while (!space.complete()) {
      flat(rates_) = flat(found) + kResponseStep * space.motion().cwiseQuotient(flat(weight));
      evaluate(moved);
      // In place: a Ref of an expression would be a copy on the heap.
      flat(moved) = (flat(moved) - flat(answer)).cwiseProduct(flat(weight)) / kResponseStep;
      space.add(flat(moved));
    }
    rates_ = found;
    place();
    return space.eigenvalues();
  }

  bool supported() const {
    for (int e = 0; e < count_; ++e) {
      const auto& free = arm_.null_space_[arm_.elements_[e].section];
      for (int j = 0; j < nodes_; ++j) {
        for (int i = 0; i < free.cols(); ++i) {
          if (std::abs(free.col(i).dot(wrench_[e * nodes_ + j])) > kNoWork * pull_) return false;
        }
      }
    }
    return true;
  }

  const LoadedArmOf& arm_;
  const Load& load_;
  const GaussRule& rule_;
  int nodes_, count_;  // Gauss points per element; elements
  UnloadedElements unloaded_;
  Tangent scale_;
  Rates rates_;
  // Last evaluated shape.
  std::array<Group, kMaxElements> start_;
  decltype(Group::rotation) at_rotation_[kMaxNodes];
  Eigen::Matrix<double, Group::kSpace, Eigen::Dynamic, Eigen::ColMajor, Group::kSpace, kMaxNodes>
      at_;
  Tangent z_[kMaxNodes];
  Tangent wrench_[kMaxNodes];  // seen from the node
  double pull_ = 0.0;          // magnitude of the whole load [N m]
  Group tip_;
  SolveStatus status_ = SolveStatus::kNotConverged;
  double residual_ = 0.0, farthest_ = 0.0;
  double share_ = 1.0;  // of the load
  int load_steps_ = 0;
  double factor_ = 0.0;         // ratio of consecutive steps
  double amplification_ = 0.0;  // 0 if the load is too small to matter
  double stiffening_ = 0.0;     // the negative one of the largest magnitude
  int iterations_ = 0;
};

}  // namespace helix_arm::statics
