#include "helix_arm/statics/exact.hpp"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/lie/so3.hpp"
#include "helix_arm/model/curve.hpp"
#include "rod.hpp"
#include "statics/loaded/gauss_rule.hpp"
#include "statics/loaded/linear_chain.hpp"
#include "statics/loaded/shape_motion.hpp"

namespace helix_arm::statics {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using lie::Matrix6;
using lie::SE3;
using lie::skew;
using lie::SO3;
using lie::Vector6;

constexpr double kContraction = 0.5;  // of Newton's steps that stay on their branch
constexpr double kLargestStep = 1.0;  // of them [rad], relative to the arm's size
constexpr double kNoise = 10;         // in tolerances: such a defect need not decrease
constexpr double kLeastGain = 0.5;    // of a damped step, relative to its fraction of Newton's step
constexpr double kShortestStep = 1e-4;  // of a damped one, as a part of Newton's
constexpr double kNegative = 1e-9;      // of an eigenvalue, relative to the largest

// Number of negative eigenvalues of the stiffness against rotations of a segment's end, with its
// start fixed and everything beyond it free: the segment's own stiffness plus that of the rest,
// whose steps satisfy the rows. The sum over the segments is the index of the second variation of
// the energy, as long as each segment is stable between two ends that do not rotate. It is
// expressed in the moments at the start, so that it also holds for infinitely stiff sections.
int unstableMotions(const Eigen::Matrix<double, 3, 6>& rows, const Matrix6& Phi) {
  const Matrix3d by_moment = Phi.topRightCorner<3, 3>();
  const Matrix3d rest = rows.rightCols<3>().fullPivLu().solve(rows.leftCols<3>());
  const Matrix3d S = by_moment.transpose() * (Phi.bottomRightCorner<3, 3>() + rest * by_moment);
  if (!S.allFinite()) return 0;
  const Vector3d eigenvalues =
      Eigen::SelfAdjointEigenSolver<Matrix3d>(0.5 * (S + S.transpose()), Eigen::EigenvaluesOnly)
          .eigenvalues();
  return static_cast<int>(
      (eigenvalues.array() < -kNegative * eigenvalues.cwiseAbs().maxCoeff()).count());
}

/// Frame and body moment at the start of a segment.
struct Node {
  lie::SO3 R;         ///< seen from the base
  Eigen::Vector3d m;  ///< [N m]
};

/// Result of Newton's method.
struct Balance {
  bool found = false;
  std::vector<Node> nodes;  ///< the solution, if found
  /// Last Newton step, relative to the arm's size and one radian.
  double residual = std::numeric_limits<double>::infinity();
};

/// Equilibrium of a loaded rod by multiple shooting: the frames and moments at the starts of all
/// segments are the unknowns of Newton's method.
///
/// Keeps references to the rod and to the unloaded state.
class MultipleShooting {
 public:
  MultipleShooting(const Rod& rod, const model::Unloaded& unloaded, const ExactOptions& options)
      : rod_(rod), unloaded_(unloaded), options_(options) {}

  /// The nodes of the arm without load.
  std::vector<Node> unloadedNodes() const {
    std::vector<Node> nodes;
    SO3 R_section;
    for (std::size_t j = 0; j < rod_.segments().size(); ++j) {
      const Segment& segment = rod_.segments()[j];
      if (j > 0 && segment.section != rod_.segments()[j - 1].section) {
        R_section = R_section * rod_.unloadedRotation(segment.section - 1, 1.0, unloaded_);
        if (const SE3* link = rod_.linkAfter(static_cast<int>(j) - 1)) {
          R_section = R_section * SO3{Eigen::Quaterniond(link->rotation)};
        }
      }
      nodes.push_back({R_section * rod_.unloadedRotation(segment.section, segment.begin, unloaded_),
                       Vector3d::Zero()});
    }
    return nodes;
  }

  /// Newton's method from given nodes, under a fraction of the load.
  /// @param damped  shorten steps until they reduce the error; otherwise, steps that leave their
  ///     branch end the search.
  /// @param iterations  incremented, up to ExactOptions::max_iterations.
  Balance balance(std::vector<Node> nodes, double share, bool damped, int& iterations) const {
    Balance out;
    Shot shot = shoot(std::move(nodes), share);
    while (std::isfinite(shot.norm)) {
      const Step step = newtonStep(shot);
      const double size = step.size();
      if (!std::isfinite(size)) return out;
      out.residual = size;
      if (size <= options_.tolerance) {
        out.found = step.unstable == 0 || (damped && !rod_.conservative());
        out.nodes = moved(shot.nodes, step, 1.0);
        return out;
      }
      if (iterations == options_.max_iterations || (!damped && size > kLargestStep)) return out;
      ++iterations;
      Shot next = shoot(moved(shot.nodes, step, 1.0), share);
      if (damped) {
        for (double factor = 0.5; !(next.norm < (1.0 - kLeastGain * factor) * shot.norm);
             factor *= 0.5) {
          if (factor < kShortestStep) return out;
          next = shoot(moved(shot.nodes, step, factor), share);
        }
      } else if (!(next.norm <= std::max(kContraction * shot.norm, kNoise * options_.tolerance))) {
        return out;
      }
      shot = std::move(next);
    }
    return out;
  }

  /// Size of the Newton step at given nodes, as Balance::residual.
  double residualOf(std::vector<Node> nodes, double share) const {
    const Shot shot = shoot(std::move(nodes), share);
    return std::isfinite(shot.norm) ? newtonStep(shot).size()
                                    : std::numeric_limits<double>::infinity();
  }

 private:
  // The arm integrated from given nodes, with the data for Newton's method.
  struct Shot {
    std::vector<Node> nodes;
    std::vector<lie::Matrix6> Phi;     // derivative of each segment's end with respect to its start
    std::vector<lie::Vector6> defect;  // difference between the segment's end and the next node;
                                       // for the last segment, the unbalanced moment
    double norm = std::numeric_limits<double>::infinity();
  };
  // One step of all nodes: rotations in the body frame [rad], moments in the rod's unit.
  struct Step {
    std::vector<Vector6> x;
    // Number of unstable motions of the shape: 0 on the branch from the unloaded shape.
    int unstable = 0;

    double size() const {
      double largest = 0.0;
      for (const Vector6& entry : x) {
        if (!entry.allFinite()) return std::numeric_limits<double>::infinity();
        largest = std::max(largest, entry.norm());
      }
      return largest;
    }
  };

  Shot shoot(std::vector<Node> nodes, double share) const {
    const int count = rod_.segmentCount();
    Shot shot;
    shot.Phi.resize(count);
    shot.defect.resize(count);
    double square = 0.0;
    for (int j = 0; j < count; ++j) {
      const auto part = rod_.flow<6>(j, unloaded_, share);
      Flow<6>::State y;
      Matrix6 start = Matrix6::Identity();
      start.bottomRightCorner<3, 3>() *= rod_.momentUnit();
      y << nodes[j].R.quaternion.coeffs(), nodes[j].m,
          Eigen::Map<const Eigen::Matrix<double, 36, 1>>(start.data());
      double h = 0.25 * (part.segment.end - part.segment.begin);
      if (!part.advance(part.segment.begin, part.segment.end, y, h)) return shot;
      Eigen::Map<Matrix6> Phi(y.data() + 7);
      const Matrix3d R_inverse = Flow<6>::rotation(y).transpose();
      Vector3d m = y.segment<3>(4);
      for (const Pull& pull : part.segment.pulls) {
        const Vector3d f = R_inverse * (share * pull.force), t = R_inverse * (share * pull.moment);
        m -= pull.offset.cross(f) + t;
        const Matrix3d by_turn = skew(pull.offset) * skew(f) + skew(t);
        Phi.bottomRows<3>() -= (by_turn * Phi.topRows<3>()).eval();
      }
      SO3 R{{y[3], y[0], y[1], y[2]}};
      const SE3* link = j + 1 < count ? rod_.linkAfter(j) : nullptr;
      if (link != nullptr) {
        // The force beyond acts at the other end of the link.
        const Segment& next = rod_.segments()[j + 1];
        const Vector3d n = R_inverse * (share * next.forceAt(next.begin));
        const Matrix3d& R_link = link->rotation;
        m = R_link.transpose() * (m - link->translation.cross(n));
        Phi.bottomRows<3>() -= skew(link->translation) * skew(n) * Phi.topRows<3>();
        Phi.topRows<3>() = (R_link.transpose() * Phi.topRows<3>()).eval();
        Phi.bottomRows<3>() = (R_link.transpose() * Phi.bottomRows<3>()).eval();
        R = R * SO3{Eigen::Quaterniond(R_link)};
      }
      Phi.bottomRows<3>() /= rod_.momentUnit();
      shot.Phi[j] = Phi;
      if (j + 1 < count) {
        shot.defect[j] << (nodes[j + 1].R.inverse() * R).log(),
            (m - nodes[j + 1].m) / rod_.momentUnit();
      } else {
        shot.defect[j] << Vector3d::Zero(), m / rod_.momentUnit();
      }
      square += shot.defect[j].squaredNorm();
    }
    shot.nodes = std::move(nodes);
    if (std::isfinite(square)) shot.norm = std::sqrt(square);
    return shot;
  }

  // Rows P x_j = c that the steps x_j must satisfy so that everything beyond node j fits,
  // propagated from tip to base. Orthonormal: components that grow towards the tip decay in them.
  Step newtonStep(const Shot& shot) const {
    using Rows = Eigen::Matrix<double, 3, 6>;
    const int count = rod_.segmentCount();
    std::vector<Rows> P(count);
    std::vector<Vector3d> c(count);
    Rows rows = Rows::Zero();
    rows.rightCols<3>().setIdentity();
    Vector3d right = Vector3d::Zero();
    Step step;
    for (int j = count - 1; j >= 0; --j) {
      right -= rows * shot.defect[j];
      step.unstable += unstableMotions(rows, shot.Phi[j]);
      rows *= shot.Phi[j];
      for (int k = 0; k < 3; ++k) {
        // Gram-Schmidt twice, which is orthonormal to rounding; Eigen's QR compiles for seconds.
        for (int i = 0; i < 2 * k; ++i) {
          const double along = rows.row(i % k).dot(rows.row(k));
          rows.row(k) -= along * rows.row(i % k);
          right[k] -= along * right[i % k];
        }
        const double length = rows.row(k).norm();
        rows.row(k) /= length;
        right[k] /= length;
      }
      P[j] = rows;
      c[j] = right;
    }
    step.x.assign(count, Vector6::Zero());
    step.x[0].tail<3>() = P[0].rightCols<3>().fullPivLu().solve(c[0]);
    for (int j = 1; j < count; ++j) {
      step.x[j] = shot.Phi[j - 1] * step.x[j - 1] + shot.defect[j - 1];
      step.x[j] -= P[j].transpose() * (P[j] * step.x[j] - c[j]);
    }
    return step;
  }

  std::vector<Node> moved(const std::vector<Node>& nodes, const Step& step, double factor) const {
    std::vector<Node> out = nodes;
    for (std::size_t j = 0; j < out.size(); ++j) {
      out[j].R = (nodes[j].R * SO3::exp(factor * step.x[j].head<3>())).normalized();
      out[j].m += factor * rod_.momentUnit() * step.x[j].tail<3>();
    }
    return out;
  }

  const Rod& rod_;
  const model::Unloaded& unloaded_;
  const ExactOptions& options_;
};

/// The equilibrium at the largest fraction of the load that was reached.
struct Reached {
  std::vector<Node> nodes;
  double share = 0.0;
  double residual = 0.0;  ///< as Balance::residual
  int iterations = 0;     ///< Newton iterations, summed over all load steps
  int load_steps = 0;
  bool snapped = false;  ///< the branch ended at a smaller load
};

constexpr double kLeastLoadStep = 1e-9;  // of the whole load
constexpr double kBranchEnd = 1e-6;      // step relative to the load at which the branch ends
constexpr int kFewIterations = 5;        // of a step, after which the next one is longer

/// Applies the load in steps, as long as Newton's method stays on the branch that grows from the
/// unloaded shape. Where it ends, the result is whichever shape damped steps find under all of it.
Reached stepLoad(const MultipleShooting& shooting, const ExactOptions& options) {
  Reached out;
  out.nodes = shooting.unloadedNodes();
  std::vector<Node> before;
  double share_before = 0.0, load_step = 1.0;
  while (out.share < 1.0) {
    const double target = load_step >= 1.0 - out.share ? 1.0 : out.share + load_step;
    std::vector<Node> guess = out.nodes;
    if (!before.empty()) {
      const double factor = (target - out.share) / (out.share - share_before);
      for (std::size_t j = 0; j < guess.size(); ++j) {
        guess[j].R =
            out.nodes[j].R * lie::SO3::exp(factor * (before[j].R.inverse() * out.nodes[j].R).log());
        guess[j].m += factor * (out.nodes[j].m - before[j].m);
      }
    }
    const int iterations_before = out.iterations;
    Balance balance = shooting.balance(std::move(guess), target, false, out.iterations);
    if (balance.found) {
      before = std::exchange(out.nodes, std::move(balance.nodes));
      share_before = std::exchange(out.share, target);
      ++out.load_steps;
      out.residual = balance.residual;
      if (out.iterations - iterations_before <= kFewIterations) load_step *= 2.0;
      continue;
    }
    if (out.iterations == options.max_iterations) break;
    load_step = 0.5 * (target - out.share);
    if (load_step >= std::max(kLeastLoadStep, kBranchEnd * out.share)) continue;
    // The branch ends here; the arm snaps to another shape, if there is one.
    balance = shooting.balance(out.nodes, 1.0, true, out.iterations);
    if (!balance.found) break;
    out.nodes = std::move(balance.nodes);
    out.residual = balance.residual;
    out.share = 1.0;
    out.snapped = true;
  }
  return out;
}

// Work on a motion that no actuator resists, relative to the load's scale: up to this value, or
// this multiple of the tolerance, it counts as zero.
constexpr double kNoWork = 1e-8;
constexpr double kNoWorkTolerances = 10;
// Gauss points of a panel of the derivatives; its largest turn [rad] and growth, resolved to 1e-12.
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
  Statics(const model::Arm& arm, const Load& load, const ExactOptions& options)
      : options_(checked(arm, load, options)),
        rod_(arm, load, options.tolerance),
        empty_(load.empty()) {}

  Solution solve(const model::Unloaded& unloaded) const {
    check(unloaded);
    return solutionOf(empty_ ? Reached{} : reach(unloaded), unloaded);
  }

  ShapeResponse differentiate(const model::Unloaded& unloaded,
                              const UnloadedChange<lie::SE3>& change, bool by_load) const {
    check(unloaded);
    const int columns = change.count() + (by_load ? 6 : 0);
    const Reached reached = reach(unloaded);
    Solution solution = solutionOf(reached, unloaded);
    if (!solution.converged()) return withoutDerivative(std::move(solution), columns);
    const std::vector<Panel> parts = panels(unloaded);
    std::vector<LinearElement<lie::SE3>> elements(parts.size());
    std::size_t place = 0;
    const Trace found =
        trace(reached, unloaded, stopsOf(parts),
              [&](const lie::SE3& X, const Vector3d&, const Vector6& wrench) {
                const Panel& panel = parts[place / (kPanelNodes + 1)];
                LinearElement<lie::SE3>& element = elements[place / (kPanelNodes + 1)];
                const auto node = static_cast<Eigen::Index>(place++ % (kPanelNodes + 1));
                if (node < kPanelNodes) {
                  element.nodes.push_back(nodeAt(panel, node, X, wrench, unloaded, change));
                } else {
                  finish(panel, X, change, element);
                }
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

  std::vector<model::CurvePoint<lie::SE3>> curve(const model::Unloaded& unloaded, int count) const {
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
              const std::vector<double>& stops, const Visit& visit) const {
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

  void check(const model::Unloaded& unloaded) const {
    basics::requireValue(unloaded.twists.cols() == rod_.sections(), "exact tier",
                         "the number of unloaded twists", unloaded.twists.cols(),
                         "one per section");
    basics::require(!rod_.tapered() || unloaded.lengths.size() > 0,
                    "exact tier: the arm is tapered; expected ArmOf::unloaded(), not twists alone");
    basics::require(!rod_.hasTables() || unloaded.compliance.size() > 0,
                    "exact tier: the stiffness depends on pressure; expected unloadedUnder(), not "
                    "twists alone");
    basics::require(unloaded.twists.allFinite(),
                    "exact tier: a twist of the unloaded arm is not finite");
  }

  // Without load, the unloaded shape.
  Reached reach(const model::Unloaded& unloaded) const {
    const MultipleShooting shooting(rod_, unloaded, options_);
    if (!empty_) return stepLoad(shooting, options_);
    return {shooting.unloadedNodes(), 1.0, 0.0, 0};
  }

  Solution solutionOf(const Reached& reached, const model::Unloaded& unloaded) const {
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

  // The Gauss points of each panel and its end, as s over the whole arm.
  std::vector<double> stopsOf(const std::vector<Panel>& parts) const {
    std::vector<double> out;
    for (const Panel& panel : parts) {
      const int k = rod_.segments()[panel.segment].section;
      for (const double t : GaussRule::of(kPanelNodes).nodes()) {
        out.push_back(k + panel.begin + t * (panel.end - panel.begin));
      }
      out.push_back(k + panel.end);
    }
    return out;
  }

  // The rate is the strain, seen from the base.
  LinearNode<lie::SE3> nodeAt(const Panel& panel, Eigen::Index node, const lie::SE3& X,
                              const Vector6& wrench, const model::Unloaded& unloaded,
                              const UnloadedChange<lie::SE3>& change) const {
    const int section = rod_.segments()[panel.segment].section;
    const double h = panel.end - panel.begin;
    const double s = panel.begin + GaussRule::of(kPanelNodes).nodes()[node] * h;
    const Matrix6 C = rod_.compliance(section, s, unloaded), Ad = h * X.adjoint();
    return {X,
            wrench,
            Matrix6::Identity(),
            Motions::Zero(6, change.columns(section)),
            Ad * C,
            Matrix6::Zero(),
            Ad * (change.twist(section, s) + change.strain(section, s, C * wrench))};
  }

  // All of an element but its nodes. @param X  its end.
  void finish(const Panel& panel, const lie::SE3& X, const UnloadedChange<lie::SE3>& change,
              LinearElement<lie::SE3>& element) const {
    const auto& rule = GaussRule::of(kPanelNodes);
    const Segment& segment = rod_.segments()[panel.segment];
    element.before = rule.before();
    element.after = rule.after();
    element.weights = rule.weights();
    element.first_column = change.first(segment.section);
    element.end_by_z.setIdentity();
    element.end = Motions::Zero(6, change.columns(segment.section));
    element.weight = (panel.end - panel.begin) * segment.weight;
    if (!panel.ends_segment) return;
    for (const Pull& pull : segment.pulls) element.pulls.push_back({X * pull.offset, pull.force});
  }

  // Between the ends of segments and of the shape's pieces, evenly.
  std::vector<Panel> panels(const model::Unloaded& unloaded) const {
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
          out.push_back({static_cast<int>(j), from, to, last && end == segment.end,
                         last && end == piece_end});
        }
        begin = end;
      }
    }
    return out;
  }

  model::Shape unloadedShape(const model::Unloaded& unloaded) const {
    const int per_section = options_.pieces_per_section;
    model::Shape::Pieces pieces(6, unloaded.twists.cols() * per_section);
    for (int j = 0; j < pieces.cols(); ++j) {
      const int k = j / per_section;
      pieces.col(j) = unloaded.twists.col(k) / per_section;
      if (!rod_.tapered()) continue;
      const double from = static_cast<double>(j % per_section) / per_section;
      const double to = (j % per_section + 1.0) / per_section;
      pieces.col(j) =
          twistNear(rod_.unloadedMotion(k, from, to, unloaded), pieces.col(j).tail<3>());
    }
    return model::Shape(pieces, per_section, rod_.links());
  }

  ExactOptions options_;
  Rod rod_;
  bool empty_;
};

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
