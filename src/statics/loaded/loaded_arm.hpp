#pragma once

#include <algorithm>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include "buckling.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "lie/jacobian_slope.hpp"
#include "relaxation.hpp"

/// Definitions of LoadedArmOf. Each group is instantiated in its own file: compilation is slow.
namespace helix_arm::statics {

inline constexpr double kDifferenceStep = 1e-4;  // relative to the arm's size and one radian

template <class Group>
TipResponseOf<Group> withoutResponse(const TipOf<Group>& tip, Eigen::Index columns) {
  using Motion = Eigen::Matrix<double, Group::kDof, Eigen::Dynamic>;
  return {tip, Motion::Constant(Group::kDof, columns, std::numeric_limits<double>::quiet_NaN())};
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
  has_tables_ = readsInputs(arm, &load_);
  may_buckle_ = bucklingBound(arm, load) >= 1.0;
}

template <class Group>
auto LoadedArmOf<Group>::solved(const Unloaded& unloaded, const Relaxation* near) const
    -> Relaxation {
  basics::require(!tapered_ || unloaded.lengths.size() == first_.back(),
                  "loaded tier: the arm is tapered; expected ArmOf::unloaded(), not twists alone");
  basics::require(!has_tables_ || unloaded.compliance.size() > 0,
                  "loaded tier: the stiffness depends on pressure; expected unloadedUnder(), not "
                  "twists alone");
  Relaxation solver(*this, unloaded, order_ + 1);
  if (near != nullptr && order_ != kLeastOrder) solver.startFrom(*near);
  solver.run(order_ == kLeastOrder);
  // A solution close to a checked one needs no check of its own.
  if (near != nullptr) return solver;
  if (may_buckle_) solver.refuseUnstable();
  const bool branches = may_buckle_ && solver.branches();
  if (branches || solver.doubtful(statedTipError(order_))) {
    check(unloaded, solver, branches);
  }
  return solver;
}

template <class Group>
[[gnu::noinline]] void LoadedArmOf<Group>::check(const Unloaded& unloaded, Relaxation& solver,
                                                 bool branches) const {
  const double stated = statedTipError(order_);
  if (branches) {
    Relaxation stepped(*this, unloaded, order_ + 1);
    stepped.stepLoad();
    solver.compareWith(stepped.result(), stated);
  }
  if (!solver.doubtful(stated)) return;
  Relaxation finer(*this, unloaded, kFineNodes);
  finer.startFrom(solver);
  finer.run(false);
  solver.compareWith(finer.result(), stated);
}

template <class Group>
TipOf<Group> LoadedArmOf<Group>::tip(const Unloaded& unloaded) const {
  return solved(unloaded).result();
}

template <class Group>
Solution LoadedArmOf<Group>::solve(const Unloaded& unloaded) const {
  return solved(unloaded).solution(static_cast<int>(unloaded.twists.cols()));
}

template <class Group>
std::vector<model::CurvePoint<lie::SE3>> LoadedArmOf<Group>::curve(const Unloaded& unloaded,
                                                                   int count) const {
  model::requireCurve(count);
  return solved(unloaded).curve(static_cast<int>(unloaded.twists.cols()), count);
}

template <class Group>
ShapeResponse LoadedArmOf<Group>::differentiate(const Unloaded& unloaded,
                                                const UnloadedChange<Group>& change,
                                                bool by_load) const {
  const int sections = static_cast<int>(unloaded.twists.cols());
  auto relaxation = solved(unloaded);
  if (!relaxation.result().converged()) {
    return withoutDerivative(relaxation.solution(sections), change.count() + (by_load ? 6 : 0));
  }
  // Without load it rests at once.
  if (!load_.empty()) relaxation.polish();
  const auto response = relaxation.respond(change, by_load);
  const Solution solution = relaxation.solution(sections);
  return ShapeResponse{solution, shapeDerivative(solution.shape, relaxation.pieceMotions(
                                                                     sections, change, response))};
}

template <class Group>
TipResponseOf<Group> LoadedArmOf<Group>::tipBy(const Unloaded& unloaded,
                                               const UnloadedChange<Group>& change) const {
  auto relaxation = solved(unloaded);
  TipResponseOf<Group> out = withoutResponse(relaxation.result(), change.count());
  if (!out.converged()) return out;
  out.by = out.tip.inverse().adjoint() * relaxation.respond(change, false).starts.back();
  return out;
}

template <class Group>
TipResponseOf<Group> LoadedArmOf<Group>::tipByUnloaded(const Twists& unloaded,
                                                       const Eigen::MatrixXd& directions) const {
  const Relaxation here = solved(unloaded);
  TipResponseOf<Group> out = withoutResponse(here.result(), directions.cols());
  for (int d = 0; d < directions.cols() && out.converged(); ++d) {
    const auto direction = directions.col(d).reshaped(Group::kDof, unloaded.cols());
    const double size = std::max(direction.template topRows<Group::kSpace>().norm() / size_,
                                 direction.template bottomRows<Group::kRotations>().norm());
    if (size == 0) {
      out.by.col(d).setZero();
      continue;
    }
    const double step = kDifferenceStep / size;
    const auto tipAt = [&](double move) {
      return solved(Twists(unloaded + move * direction), &here).result();
    };
    const TipOf<Group> below = tipAt(-step), above = tipAt(step);
    if (!below.converged()) out.status = below.status;
    if (!above.converged()) out.status = above.status;
    if (!out.converged()) return withoutResponse<Group>(out, directions.cols());
    out.by.col(d) = (below.tip.inverse() * above.tip).log() / (2.0 * step);
  }
  return out;
}

}  // namespace helix_arm::statics
