#include "helix_arm/statics/exact.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "gauss_rule.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve_place.hpp"
#include "linear_chain.hpp"
#include "load_steps.hpp"
#include "multiple_shooting.hpp"
#include "rod.hpp"
#include "shape_motion.hpp"
#include "twist_near.hpp"

namespace helix_arm::statics {
namespace {

using Eigen::Vector3d;
using lie::Vector6;

// Work on a motion that no actuator resists, relative to the load's scale: up to this value, or
// this multiple of the tolerance, it counts as zero.
constexpr double kNoWork = 1e-8;
constexpr double kNoWorkTolerances = 10;
// Gauss points of a panel of the derivatives, and its largest turn [rad] and e-fold growth, which
// they resolve to 1e-12.
constexpr int kPanelNodes = 8;
constexpr double kPanelTurn = 1.2;

// Checks the options, which must suit the arm and its load.
const ExactOptions& checked(const model::Arm& arm, const Load& load, const ExactOptions& options) {
  const int sections = arm.sectionCount();
  load.validate(sections);
  options.validate();
  basics::requireValue(sections * options.pieces_per_section <= model::kMaxPieces, "exact tier",
                       "the number of pieces of all sections",
                       sections * options.pieces_per_section,
                       "at most 128; lower pieces_per_section");
  return options;
}

}  // namespace

void ExactOptions::validate() const {
  const auto check = [](bool holds, const char* what, double value, const char* rule) {
    basics::requireValue(holds, "exact tier", what, value, rule);
  };
  check(tolerance >= 1e-13 && tolerance <= 1e-2, "tolerance", tolerance, "1e-13 to 1e-2");
  check(max_iterations >= 1, "max_iterations", max_iterations, "at least 1");
  check(pieces_per_section >= 1 && pieces_per_section <= model::kMaxPieces, "pieces_per_section",
        pieces_per_section, "1 to 128");
}

class ExactArm::Statics {
 public:
  Statics(const model::Arm& arm, const Load& load, const ExactOptions& options);
  Solution solve(const model::Unloaded& unloaded) const;
  ShapeResponse differentiate(const model::Unloaded& unloaded,
                              const UnloadedChange<lie::SE3>& change, bool by_load) const;
  std::vector<model::CurvePoint<lie::SE3>> curve(const model::Unloaded& unloaded, int count) const;

 private:
  // Part of a segment on which the linear equations are solved at Gauss points.
  struct Panel {
    int segment;
    double begin, end;  // s of the section
    bool ends_segment, ends_piece;
  };

  // Counters and faults of an integration along the arm.
  struct Trace {
    bool finite = true;
    bool supported = true;
  };

  // Calls visit(X, turned, wrench) at each of the stops, which are non-decreasing s over the whole
  // arm, with the pose there, the integral of the angular strain up to it and the body wrench.
  template <class Visit>
  Trace trace(const Reached& reached, const model::Unloaded& unloaded,
              const std::vector<double>& stops, const Visit& visit) const;
  void check(const model::Unloaded& unloaded) const;
  Reached reach(const model::Unloaded& unloaded) const;
  Solution solutionOf(const Reached& reached, const model::Unloaded& unloaded) const;
  std::vector<Panel> panels(const model::Unloaded& unloaded) const;
  model::Shape unloadedShape(const model::Unloaded& unloaded) const;

  ExactOptions options_;
  Rod rod_;
  bool empty_;
};

ExactArm::Statics::Statics(const model::Arm& arm, const Load& load, const ExactOptions& options)
    : options_(checked(arm, load, options)),
      rod_(arm, load, options.tolerance),
      empty_(load.empty()) {}

template <class Visit>
ExactArm::Statics::Trace ExactArm::Statics::trace(const Reached& reached,
                                                  const model::Unloaded& unloaded,
                                                  const std::vector<double>& stops,
                                                  const Visit& visit) const {
  Trace out;
  Flow<0>::State y = Flow<0>::State::Zero();
  double h = 1.0 / options_.pieces_per_section;
  std::size_t next = 0;
  for (std::size_t j = 0; j < rod_.segments().size(); ++j) {
    const auto part = rod_.flow<0>(static_cast<int>(j), unloaded, reached.share);
    const auto& N = part.law.null_space;
    const auto checkSupport = [&](double s) {
      const Vector6 w = part.wrench(s, y);
      for (int i = 0; i < N.cols(); ++i) {
        const double scale = N.col(i).head<3>().norm() * rod_.forceScale() +
                             N.col(i).tail<3>().norm() * rod_.momentScale();
        out.supported &=
            std::abs(N.col(i).dot(w)) <=
            std::max(kNoWork, kNoWorkTolerances * options_.tolerance) * reached.share * scale;
      }
    };
    y.head<7>() << reached.nodes[j].R.quaternion.coeffs(), reached.nodes[j].m;
    double s = part.segment.begin;
    const double end = part.segment.end;
    checkSupport(s);
    while (s < end || (next < stops.size() && stops[next] - part.segment.section <= end)) {
      const double stop = next < stops.size() ? stops[next] - part.segment.section : end;
      const double to = std::clamp(stop, s, end);
      if (!part.advance(s, to, y, h)) {
        out.finite = false;
        return out;
      }
      s = to;
      checkSupport(s);
      if (next == stops.size() || s < stop) continue;
      visit(lie::SE3{Flow<0>::rotation(y), y.segment<3>(7)}, Vector3d(y.tail<3>()),
            part.wrench(s, y));
      ++next;
    }
    if (const lie::SE3* link = rod_.linkAfter(static_cast<int>(j))) {
      y.segment<3>(7) += Flow<0>::rotation(y) * link->translation;
    }
  }
  return out;
}

model::Shape ExactArm::Statics::unloadedShape(const model::Unloaded& unloaded) const {
  const int per_section = options_.pieces_per_section;
  model::Shape::Pieces pieces(6, unloaded.twists.cols() * per_section);
  for (int j = 0; j < pieces.cols(); ++j) {
    const int k = j / per_section;
    pieces.col(j) = unloaded.twists.col(k) / per_section;
    if (!rod_.tapered()) continue;
    const double from = static_cast<double>(j % per_section) / per_section;
    const double to = (j % per_section + 1.0) / per_section;
    pieces.col(j) = twistNear(rod_.unloadedMotion(k, from, to, unloaded), pieces.col(j).tail<3>());
  }
  return model::Shape(pieces, per_section, rod_.links());
}

void ExactArm::Statics::check(const model::Unloaded& unloaded) const {
  basics::requireValue(unloaded.twists.cols() == rod_.sections(), "exact tier",
                       "the number of unloaded twists", unloaded.twists.cols(), "one per section");
  basics::require(!rod_.tapered() || unloaded.lengths.size() > 0,
                  "exact tier: the arm is tapered; expected ArmOf::unloaded(), not twists alone");
  basics::require(
      !rod_.hasTables() || unloaded.compliance.size() > 0,
      "exact tier: K_eps depends on pressure; expected unloadedUnder(), not twists alone");
  basics::require(unloaded.twists.allFinite(),
                  "exact tier: a twist of the unloaded arm is not finite");
}

// Without load, the unloaded shape.
Reached ExactArm::Statics::reach(const model::Unloaded& unloaded) const {
  const MultipleShooting shooting(rod_, unloaded, options_);
  if (!empty_) return stepLoad(shooting, options_);
  return {shooting.unloadedNodes(), 1.0, 0.0, 0};
}

Solution ExactArm::Statics::solve(const model::Unloaded& unloaded) const {
  check(unloaded);
  return solutionOf(empty_ ? Reached{} : reach(unloaded), unloaded);
}

Solution ExactArm::Statics::solutionOf(const Reached& reached,
                                       const model::Unloaded& unloaded) const {
  Solution solution;
  solution.shape = unloadedShape(unloaded);
  for (int k = 0; k < unloaded.twists.cols(); ++k) {
    solution.tip = solution.tip * rod_.unloadedMotion(k, 0.0, 1.0, unloaded);
    if (rod_.links()) solution.tip = solution.tip * (*rod_.links())[k];
  }
  if (empty_) return solution;

  solution.iterations = reached.iterations;
  solution.load_steps = reached.load_steps;
  // With moments that keep their direction, the steps may end although the branch goes on.
  if (reached.snapped && rod_.conservative()) solution.status = SolveStatus::kSnapped;
  solution.residual = reached.residual;
  if (reached.share < 1.0) {
    solution.status = SolveStatus::kNotConverged;
    solution.residual = MultipleShooting(rod_, unloaded, options_).residualOf(reached.nodes, 1.0);
  }
  if (reached.share == 0.0) return solution;
  const int per_section = options_.pieces_per_section;
  std::vector<double> stops;
  for (int k = 0; k < unloaded.twists.cols(); ++k) {
    for (int piece = 1; piece < per_section; ++piece) {
      stops.push_back(k + static_cast<double>(piece) / per_section);
    }
    stops.push_back(k + 1.0);
  }
  model::Shape::Pieces pieces(6, unloaded.twists.cols() * per_section);
  lie::SE3 X_start;
  Vector3d turned_start = Vector3d::Zero();
  int piece = 0;
  const Trace found = trace(
      reached, unloaded, stops, [&](const lie::SE3& X, const Vector3d& turned, const Vector6&) {
        pieces.col(piece++) = twistNear(X_start.inverse() * X, turned - turned_start);
        X_start = X;
        turned_start = turned;
        if (rod_.links() && piece % per_section == 0) {
          X_start = X * (*rod_.links())[piece / per_section - 1];
        }
      });
  if (!found.finite || !pieces.allFinite()) {
    solution.status = SolveStatus::kNotConverged;
    solution.residual = std::numeric_limits<double>::infinity();
    return solution;
  }
  if (!found.supported) solution.status = SolveStatus::kUnsupported;
  solution.shape = model::Shape(pieces, per_section, rod_.links());
  solution.tip = X_start;
  return solution;
}

// Between the ends of segments and of the shape's pieces, evenly.
std::vector<ExactArm::Statics::Panel> ExactArm::Statics::panels(
    const model::Unloaded& unloaded) const {
  std::vector<Panel> out;
  const int pieces = options_.pieces_per_section;
  for (std::size_t j = 0; j < rod_.segments().size(); ++j) {
    const Segment& segment = rod_.segments()[j];
    const double turn = unloaded.twists.col(segment.section).tail<3>().norm();
    double begin = segment.begin;
    while (begin < segment.end) {
      int piece = static_cast<int>(begin * pieces);
      if ((piece + 1.0) / pieces <= begin) ++piece;
      const double piece_end = (piece + 1.0) / pieces;
      const double end = std::min(segment.end, piece_end);
      const double size = (end - begin) * (turn + segment.growth / (segment.end - segment.begin));
      const int parts = std::max(1, static_cast<int>(std::ceil(size / kPanelTurn)));
      for (int i = 0; i < parts; ++i) {
        const bool last = i + 1 == parts;
        const double from = begin + (end - begin) * i / parts;
        const double to = last ? end : begin + (end - begin) * (i + 1) / parts;
        out.push_back(
            {static_cast<int>(j), from, to, last && end == segment.end, last && end == piece_end});
      }
      begin = end;
    }
  }
  return out;
}

ShapeResponse ExactArm::Statics::differentiate(const model::Unloaded& unloaded,
                                               const UnloadedChange<lie::SE3>& change,
                                               bool by_load) const {
  check(unloaded);
  const int columns = change.count() + (by_load ? 6 : 0);
  const Reached reached = reach(unloaded);
  Solution solution = solutionOf(reached, unloaded);
  if (!solution.converged()) return withoutDerivative(std::move(solution), columns);
  const auto& rule = GaussRule<kPanelNodes>::get();
  const std::vector<Panel> parts = panels(unloaded);
  std::vector<double> stops;
  for (const Panel& panel : parts) {
    const int k = rod_.segments()[panel.segment].section;
    for (const double t : rule.nodes()) {
      stops.push_back(k + panel.begin + t * (panel.end - panel.begin));
    }
    stops.push_back(k + panel.end);
  }
  std::vector<LinearElement<lie::SE3>> elements(parts.size());
  std::size_t place = 0;
  const Trace found = trace(
      reached, unloaded, stops, [&](const lie::SE3& X, const Vector3d&, const Vector6& wrench) {
        const Panel& panel = parts[place / (kPanelNodes + 1)];
        LinearElement<lie::SE3>& element = elements[place / (kPanelNodes + 1)];
        const std::size_t node = place++ % (kPanelNodes + 1);
        const Segment& segment = rod_.segments()[panel.segment];
        const double h = panel.end - panel.begin;
        const auto own = static_cast<Eigen::Index>(change.columns(segment.section));
        if (node < kPanelNodes) {
          const double s = panel.begin + rule.nodes()[static_cast<Eigen::Index>(node)] * h;
          const lie::Matrix6 C = rod_.compliance(segment.section, s, unloaded);
          const lie::Matrix6 Ad = h * X.adjoint();
          // The rate is the strain, seen from the base.
          element.nodes.push_back({X, wrench, lie::Matrix6::Identity(), Motions::Zero(6, own),
                                   Ad * C, lie::Matrix6::Zero(),
                                   Ad * (change.twist(segment.section, s) +
                                         change.strain(segment.section, s, C * wrench))});
          return;
        }
        element.before = rule.before();
        element.after = rule.after();
        element.weights = rule.weights();
        element.first_column = change.first(segment.section);
        element.end_by_z.setIdentity();
        element.end = Motions::Zero(6, own);
        element.weight = h * segment.weight;
        if (!panel.ends_segment) return;
        for (const Pull& pull : segment.pulls)
          element.pulls.push_back({X * pull.offset, pull.force});
      });
  if (!found.finite) {
    solution.status = SolveStatus::kNotConverged;
    return withoutDerivative(std::move(solution), columns);
  }
  const auto response = LinearChain<lie::SE3>(elements).balanced(
      wrenchesAt<lie::SE3>(solution.tip.translation, change.count(), by_load));
  std::vector<Motions> ends;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (parts[i].ends_piece) ends.push_back(response.starts[i + 1]);
  }
  const ShapeDerivative by = shapeDerivative(solution.shape, ends);
  return {std::move(solution), by};
}

std::vector<model::CurvePoint<lie::SE3>> ExactArm::Statics::curve(const model::Unloaded& unloaded,
                                                                  int count) const {
  model::requireCurve(count);
  check(unloaded);
  const int sections = static_cast<int>(unloaded.twists.cols());
  const Reached reached = empty_ ? Reached{} : reach(unloaded);
  if (reached.share < 1.0) return model::sampleCurve(solutionOf(reached, unloaded).shape, count);
  std::vector<double> stops;
  for (int i = 0; i < count; ++i) stops.push_back(model::curvePlace(sections, i, count));
  std::vector<model::CurvePoint<lie::SE3>> out;
  out.reserve(count);
  const Trace found =
      trace(reached, unloaded, stops, [&](const lie::SE3& X, const Vector3d&, const Vector6&) {
        const double s = stops[out.size()];
        const int k = static_cast<int>(s);
        // Where two sections meet, the curve continues beyond the link.
        const bool joint = rod_.links() && k > 0 && k < sections && s == k;
        out.push_back({s, joint ? X * (*rod_.links())[k - 1] : X});
      });
  return found.finite ? out : model::sampleCurve(solutionOf(reached, unloaded).shape, count);
}

ExactArm::ExactArm(const model::Arm& arm, const Load& load, const ExactOptions& options)
    : statics_(std::make_shared<const Statics>(arm, load, options)) {}

Solution ExactArm::solve(const model::Unloaded& unloaded) const {
  return statics_->solve(unloaded);
}

ShapeResponse ExactArm::differentiate(const model::Unloaded& unloaded,
                                      const UnloadedChange<lie::SE3>& change, bool by_load) const {
  return statics_->differentiate(unloaded, change, by_load);
}

std::vector<model::CurvePoint<lie::SE3>> ExactArm::curve(const model::Unloaded& unloaded,
                                                         int count) const {
  return statics_->curve(unloaded, count);
}

}  // namespace helix_arm::statics
