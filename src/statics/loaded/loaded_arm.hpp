#pragma once

#include <algorithm>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include "buckling.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/model/taper.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "lie/jacobian_slope.hpp"
#include "relaxation.hpp"

/// Derivatives of solutions of the loaded tier.
namespace helix_arm::statics {

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

template <class Group>
template <int kNodes>
LinearElement<Group> LoadedArmOf<Group>::Relaxation<kNodes>::linearised(
    int e, const UnloadedChange<Group>& change) const {
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
  for (int j = 0; j < kNodes; ++j) {
    const int node = e * kNodes + j;
    const Tangent& z = z_[node];
    const Matrix Ad_unloaded = unloaded_.atNode(node).adjoint();
    const Matrix& C = unloaded_.compliance(e, j);
    const Matrix Jr_inverse = Group::rightJacobianInverse(z);
    const Tangent strain = C * wrench_[node];
    const Tangent moved_strain = element.length * (Ad_unloaded * strain);
    LinearNode<Group> linear;
    linear.X = {at_rotation_[node], at_[node]};
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
  const Tangent z = rates_.template middleCols<kNodes>(e * kNodes) * rule_.weights();
  const Group before_unloaded = start * Group::exp(z);
  out.end_by_z = start.adjoint() * Group::leftJacobian(z);
  out.end = before_unloaded.adjoint() * unloaded[kNodes];
  out.weight = within<Group>(element.length * load_.mass[element.section] * load_.gravity);
  const Group end = before_unloaded * unloaded_.end(e);
  for (const int p : element.points) {
    const PointLoad& point = load_.points[p];
    out.pulls.push_back({end * within<Group>(point.offset), within<Group>(load_.forceOf(point))});
  }
  return out;
}

template <class Group>
template <int kNodes>
std::vector<LinearElement<Group>> LoadedArmOf<Group>::Relaxation<kNodes>::linearised(
    const UnloadedChange<Group>& change) const {
  std::vector<LinearElement<Group>> out;
  for (int e = 0; e < count_; ++e) out.push_back(linearised(e, change));
  return out;
}

template <class Group>
template <int kNodes>
typename LinearChain<Group>::Motion LoadedArmOf<Group>::Relaxation<kNodes>::wrenchAtTip(
    int parameters, bool by_load) const {
  return wrenchesAt<Group>(tip_.translation, parameters, by_load);
}

template <class Group>
template <int kNodes>
void LoadedArmOf<Group>::Relaxation<kNodes>::polish() {
  if (kNodes == kLeastOrder + 1) return;  // its result is no fixed point
  Rates answer;
  evaluate(answer);
  const NoChange<Group> none;
  std::vector<LinearElement<Group>> elements = linearised(none);
  for (int node = 0; node < rates_.cols(); ++node) {
    elements[node / kNodes].nodes[node % kNodes].rate = answer.col(node) - rates_.col(node);
  }
  const auto step = LinearChain<Group>(elements).balanced(wrenchAtTip(1, false));
  for (int e = 0; e < count_; ++e) {
    rates_.template middleCols<kNodes>(e * kNodes) += step.rates[e].reshaped(kDof, kNodes);
  }
  place();
}

template <class Group>
template <int kNodes>
typename LinearChain<Group>::Response LoadedArmOf<Group>::Relaxation<kNodes>::respond(
    const UnloadedChange<Group>& change, bool by_load) {
  if (kNodes == kLeastOrder + 1) return respondToOneStep(change, by_load);
  Rates answer;
  evaluate(answer);
  return LinearChain<Group>(linearised(change)).balanced(wrenchAtTip(change.count(), by_load));
}

// The derivative of takeOneStep().
template <class Group>
template <int kNodes>
typename LinearChain<Group>::Response LoadedArmOf<Group>::Relaxation<kNodes>::respondToOneStep(
    const UnloadedChange<Group>& change, bool by_load) {
  using Matrices = std::vector<Eigen::MatrixXd>;
  const Eigen::Index columns = wrenchAtTip(change.count(), by_load).cols();
  const auto answerTo = [&](const Matrices& rates) {
    return LinearChain<Group>(linearised(change))
        .answer(rates, wrenchAtTip(change.count(), by_load));
  };
  const Rates found = rates_;
  Rates first, second;
  rates_.setZero();
  evaluate(first);
  const Matrices by_first =
      answerTo(Matrices(static_cast<std::size_t>(count_), Eigen::MatrixXd::Zero(kRates, columns)))
          .rates;
  rates_ = first;
  evaluate(second);
  const Matrices by_second = answerTo(by_first).rates;
  // factor = first . (second - first) / |first|^2
  const Rates step = second - first;
  Rates weight = scale_.cwiseAbs2().replicate(1, rates_.cols());
  const double square = flat(weight).dot(first.reshaped().cwiseAbs2());
  const double factor =
      square > 0 ? flat(weight).cwiseProduct(first.reshaped()).dot(step.reshaped()) / square : 0.0;
  Eigen::RowVectorXd by_factor = Eigen::RowVectorXd::Zero(columns);
  for (int e = 0; e < count_ && square > 0; ++e) {
    const auto at = [&](const Rates& rates) {
      return rates.template middleCols<kNodes>(e * kNodes).reshaped();
    };
    const Eigen::VectorXd w = at(weight);
    by_factor += (w.cwiseProduct(at(step)) - 2.0 * factor * w.cwiseProduct(at(first))).transpose() *
                     by_first[e] / square +
                 w.cwiseProduct(at(first)).transpose() * (by_second[e] - by_first[e]) / square;
  }
  Matrices by_found;
  for (int e = 0; e < count_; ++e) {
    const Eigen::VectorXd of_step = step.template middleCols<kNodes>(e * kNodes).reshaped();
    by_found.push_back(by_second[e] + factor / (1.0 - factor) * (by_second[e] - by_first[e]) +
                       of_step * by_factor / ((1.0 - factor) * (1.0 - factor)));
  }
  rates_ = found;
  evaluate(second);
  typename LinearChain<Group>::Response out = answerTo(by_found);
  out.rates = by_found;
  return out;
}

template <class Group>
template <int kNodes>
std::vector<Eigen::Matrix<double, 6, Eigen::Dynamic>>
LoadedArmOf<Group>::Relaxation<kNodes>::pieceMotions(
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
    const Eigen::Matrix<double, kNodes, 1> weights = rule_.upTo(t);
    const Tangent z = rates_.template middleCols<kNodes>(e * kNodes) * weights;
    Motion by_z = Motion::Zero(kDof, response.starts[e].cols());
    for (int l = 0; l < kNodes; ++l) {
      by_z += weights[l] * response.rates[e].template middleRows<kDof>(kDof * l);
    }
    Motion motion = response.starts[e] + start_[e].adjoint() * Group::leftJacobian(z) * by_z;
    motion.middleCols(change.first(section), change.columns(section)) +=
        (start_[e] * Group::exp(z)).adjoint() * unloaded_.changeAt(e, t, change, unloaded);
    out.push_back(motionsInSpace(motion));
  }
  return out;
}

// Definitions of LoadedArmOf. Each group is instantiated in a separate file, since compilation is
// slow.

inline constexpr double kDifferenceStep = 1e-4;  // relative to the arm's size and one radian

/// Calls f with the number of nodes for an order as a compile-time constant.
template <class F>
inline auto withNodes(int order, const F& f) {
  switch (order) {
    case 2:
      return f(std::integral_constant<int, 3>());
    case 3:
      return f(std::integral_constant<int, 4>());
    case 4:
      return f(std::integral_constant<int, 5>());
    case 5:
      return f(std::integral_constant<int, 6>());
    case 6:
      return f(std::integral_constant<int, 7>());
    case 7:
      return f(std::integral_constant<int, 8>());
    default:
      return f(std::integral_constant<int, 9>());
  }
}

inline std::shared_ptr<const model::Links> linksInSpace(const model::Arm& arm) {
  return arm.links();
}
inline std::shared_ptr<const model::Links> linksInSpace(const model::PlanarArm& arm) {
  return model::embed(arm).links();
}

template <class Group>
LoadedArmOf<Group>::LoadedArmOf(const model::ArmOf<Group>& arm, const Load& load, int order)
    : order_(order),
      load_(load.atEnds(linksInSpace(arm).get())),
      links_(arm.links()),
      links_in_space_(linksInSpace(arm)),
      size_(arm.restLength()) {
  basics::requireValue(order >= kLeastOrder && order <= kMostOrder, "loaded tier", "the order",
                       order, "2 to 8");
  const int sections = arm.sectionCount();
  load.validate(sections);
  std::set<double> cuts;  // s over the whole arm
  for (const PointLoad& point : load_.points) {
    if (point.s > 0 && point.s < 1) cuts.insert(point.section + point.s);
  }
  basics::requireValue(load.innerPlaces() <= kMaxInnerPoints, "load.points",
                       "the number of places inside sections", load.innerPlaces(),
                       "at most 16 with tier: loaded; combine points that are close to each other, "
                       "or use tier: exact");
  for (int k = 0; k <= sections; ++k) cuts.insert(k);
  for (int k = 0; k < sections; ++k) {
    const auto& taper = arm.taper(k);
    for (int cell = 1; taper && cell < taper->cells(); ++cell) {
      cuts.insert(k + static_cast<double>(cell) / taper->cells());
    }
    tapers_.push_back(taper);
    tapered_ = tapered_ || taper;
    per_K_.push_back(arm.freeLength(k) / load.K_eps[k]);
    first_.push_back(arm.firstActuator(k));
  }
  first_.push_back(arm.actuatorCount());
  basics::requireValue(static_cast<int>(cuts.size()) - 1 <= kMaxElements, "loaded tier",
                       "the number of parts between section ends, point loads and values of tapers",
                       static_cast<double>(cuts.size()) - 1, "at most 32; use tier: exact");
  for (auto begin = cuts.begin(), end = std::next(begin); end != cuts.end(); ++begin, ++end) {
    const int section = std::min(static_cast<int>(*begin), sections - 1);
    Element element{section, *begin - section, *end - *begin, {}};
    for (std::size_t p = 0; p < load_.points.size(); ++p) {
      if (load_.points[p].section + load_.points[p].s == *end) {
        element.points.push_back(static_cast<int>(p));
      }
    }
    element.linked = links_ != nullptr && *end == section + 1;
    elements_.push_back(std::move(element));
  }
  for (int k = 0; k < sections; ++k) {
    compliance_.push_back(complianceOf(arm, load, k));
    null_space_.push_back(arm.equilibrium(k).null_space);
  }
  requireTables(arm, load_);
  has_tables_ = !load_.tables.empty();
  may_buckle_ = bucklingBound(arm, load) >= 1.0;
}

template <class Group>
template <class Solver>
Solver LoadedArmOf<Group>::solved(const Load& load, const Unloaded& unloaded,
                                  const Solver* near) const {
  basics::require(!tapered_ || unloaded.lengths.size() == first_.back(),
                  "loaded tier: the arm is tapered; expected ArmOf::unloaded(), not twists alone");
  basics::require(!has_tables_ || unloaded.compliance.size() > 0,
                  "loaded tier: K_eps depends on pressure; expected unloadedUnder(), not twists "
                  "alone");
  Solver solver(*this, load, unloaded);
  if (near != nullptr && order_ != kLeastOrder) solver.startFrom(*near);
  solver.run(order_ == kLeastOrder);
  // A solution close to a checked one needs no check of its own.
  if (near != nullptr) return solver;
  if (may_buckle_) solver.refuseUnstable();
  const bool branches = may_buckle_ && solver.branches();
  if (branches || solver.doubtful(statedTipError(order_))) {
    check(load, unloaded, solver, branches);
  }
  return solver;
}

template <class Group>
template <class Solver>
[[gnu::noinline]] void LoadedArmOf<Group>::check(const Load& load, const Unloaded& unloaded,
                                                 Solver& solver, bool branches) const {
  Relaxation<kFineNodes> finer(*this, load, unloaded);
  if (branches) {
    finer.stepLoad();
  } else {
    finer.startAt([&solver](int e, double t) { return solver.rateAt(e, t); });
    finer.run(false);
  }
  solver.compareWith(finer.result(), statedTipError(order_));
}

template <class Group>
LoadedArmOf<Group>::Response::Response(const TipOf<Group>& tip, Eigen::Index columns)
    : at(tip),
      by(Motion::Constant(Group::kDof, columns, std::numeric_limits<double>::quiet_NaN())) {}

template <class Group>
void LoadedArmOf<Group>::Response::add(int column, double step, const TipOf<Group>& below,
                                       const TipOf<Group>& above) {
  if (!below.converged()) at.status = below.status;
  if (!above.converged()) at.status = above.status;
  if (!at.converged()) {
    by.setConstant(std::numeric_limits<double>::quiet_NaN());
    return;
  }
  by.col(column) = (below.tip.inverse() * above.tip).log() / (2.0 * step);
}

template <class Group>
TipOf<Group> LoadedArmOf<Group>::tip(const Unloaded& unloaded) const {
  return withNodes(order_, [&](auto nodes) {
    return solved<Relaxation<nodes()>>(load_, unloaded, nullptr).result();
  });
}

template <class Group>
Solution LoadedArmOf<Group>::solve(const Unloaded& unloaded) const {
  return withNodes(order_, [&](auto nodes) {
    return solved<Relaxation<nodes()>>(load_, unloaded, nullptr)
        .solution(static_cast<int>(unloaded.twists.cols()));
  });
}

template <class Group>
std::vector<model::CurvePoint<lie::SE3>> LoadedArmOf<Group>::curve(const Unloaded& unloaded,
                                                                   int count) const {
  model::requireCurve(count);
  return withNodes(order_, [&](auto nodes) {
    return solved<Relaxation<nodes()>>(load_, unloaded, nullptr)
        .curve(static_cast<int>(unloaded.twists.cols()), count);
  });
}

template <class Group>
ShapeResponse LoadedArmOf<Group>::differentiate(const Unloaded& unloaded,
                                                const UnloadedChange<Group>& change,
                                                bool by_load) const {
  return withNodes(order_, [&](auto nodes) {
    const int sections = static_cast<int>(unloaded.twists.cols());
    auto relaxation = solved<Relaxation<nodes()>>(load_, unloaded, nullptr);
    if (!relaxation.result().converged()) {
      return withoutDerivative(relaxation.solution(sections), change.count() + (by_load ? 6 : 0));
    }
    // Without load it rests at once.
    if (!load_.empty()) relaxation.polish();
    const auto response = relaxation.respond(change, by_load);
    const Solution solution = relaxation.solution(sections);
    return ShapeResponse{
        solution,
        shapeDerivative(solution.shape, relaxation.pieceMotions(sections, change, response))};
  });
}

template <class Group>
typename LoadedArmOf<Group>::Response LoadedArmOf<Group>::tipBy(
    const Unloaded& unloaded, const UnloadedChange<Group>& change) const {
  return withNodes(order_, [&](auto nodes) {
    auto relaxation = solved<Relaxation<nodes()>>(load_, unloaded, nullptr);
    Response out(relaxation.result(), change.count());
    if (!out.at.converged()) return out;
    out.by = out.at.tip.inverse().adjoint() * relaxation.respond(change, false).starts.back();
    return out;
  });
}

template <class Group>
typename LoadedArmOf<Group>::Response LoadedArmOf<Group>::tipByUnloaded(
    const Twists& unloaded, const Eigen::MatrixXd& directions) const {
  return withNodes(order_, [&](auto nodes) {
    using Solver = Relaxation<nodes()>;
    const Solver here = solved<Solver>(load_, unloaded, nullptr);
    Response out(here.result(), directions.cols());
    for (int d = 0; d < directions.cols() && out.at.converged(); ++d) {
      const auto direction = directions.col(d).reshaped(Group::kDof, unloaded.cols());
      const double size = std::max(direction.template topRows<Group::kSpace>().norm() / size_,
                                   direction.template bottomRows<Group::kRotations>().norm());
      if (size == 0) {
        out.by.col(d).setZero();
        continue;
      }
      const double step = kDifferenceStep / size;
      out.add(d, step, solved<Solver>(load_, Twists(unloaded - step * direction), &here).result(),
              solved<Solver>(load_, Twists(unloaded + step * direction), &here).result());
    }
    return out;
  });
}

template <class Group>
typename LoadedArmOf<Group>::Response LoadedArmOf<Group>::tipByLoad(const Twists& unloaded) const {
  // Units of moment and force: they turn the softest section by about one radian.
  double softest = 0.0;
  for (const auto& C : compliance_) {
    softest = std::max(softest,
                       C.template bottomRightCorner<Group::kRotations, Group::kRotations>().norm());
  }
  const double moment = 1.0 / softest, force = moment / size_, pull = load_.gravity.norm();
  const double mass = pull > 0 ? force / pull : 1.0;
  // Load entries in the order of the columns, each with its unit.
  Load load = load_;
  std::vector<std::pair<double*, double>> entries;
  for (double& of_section : load.mass) entries.emplace_back(&of_section, mass);
  for (PointLoad& point : load.points) {
    entries.emplace_back(&point.mass, mass);
    for (int i = 0; i < 3; ++i) entries.emplace_back(&point.force[i], force);
    for (int i = 0; i < 3; ++i) entries.emplace_back(&point.moment[i], moment);
  }
  return withNodes(order_, [&](auto nodes) {
    using Solver = Relaxation<nodes()>;
    const Solver here = solved<Solver>(load, unloaded, nullptr);
    Response out(here.result(), static_cast<Eigen::Index>(entries.size()));
    for (std::size_t i = 0; i < entries.size() && out.at.converged(); ++i) {
      const auto [entry, unit] = entries[i];
      const double kept = *entry, step = kDifferenceStep * unit;
      *entry = kept - step;
      const TipOf<Group> below = solved<Solver>(load, unloaded, &here).result();
      *entry = kept + step;
      const TipOf<Group> above = solved<Solver>(load, unloaded, &here).result();
      *entry = kept;
      out.add(static_cast<int>(i), step, below, above);
    }
    return out;
  });
}

}  // namespace helix_arm::statics
