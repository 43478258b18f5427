#include "helix_arm/statics/exact.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "compliance.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve_place.hpp"
#include "rod_flow.hpp"
#include "twist_near.hpp"

namespace helix_arm::statics {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using lie::Matrix6;
using lie::skew;
using lie::Vector6;

constexpr double kGrowth = 2.5;          // e-fold growth of errors that a segment may have
constexpr int kMaxSegments = 64;         // that a section is cut into for it
constexpr double kContraction = 0.5;     // of Newton's steps that stay on their branch
constexpr double kLargestStep = 1.0;     // of them [rad], relative to the arm's size
constexpr double kLeastLoadStep = 1e-9;  // of the whole load
constexpr double kBranchEnd = 1e-6;      // step by share of the load where the branch ends
constexpr double kNoWork = 1e-8;         // of the load's scale

// Frame and body moment at the start of a segment.
struct Node {
  Quaterniond R;
  Vector3d m;  // [N m]
};

// One step for all nodes: turns in the body frame [rad], moments in the rod's unit.
struct Step {
  std::vector<Vector6> x;
  // Of how many motions the shape is unstable in: 0 on the branch from the unloaded shape.
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

// exp of a turn.
Quaterniond turn(const Vector3d& w) {
  const double angle = w.norm();
  const double sinc = angle > 1e-8 ? std::sin(0.5 * angle) / angle : 0.5;
  Quaterniond q;
  q.w() = std::cos(0.5 * angle);
  q.vec() = sinc * w;
  return q;
}

// The turn from a to b, seen from a.
Vector3d turnBetween(const Quaterniond& a, const Quaterniond& b) {
  Quaterniond q = a.conjugate() * b;
  if (q.w() < 0) q.coeffs() *= -1.0;
  const double sine = q.vec().norm();
  return (sine > 1e-8 ? 2.0 * std::atan2(sine, q.w()) / sine : 2.0) * q.vec();
}

// Number of negative eigenvalues of the stiffness against turns of a segment's end, its start held
// and all beyond it free: the segment's own and that of the rest, whose steps satisfy the rows.
// Summed over the segments this is the index of the second variation of the energy, as long as each
// segment is stable between two ends that do not turn. Seen from the moments at the start, so that
// it holds for sections that are stiff without bound.
int unstableMotions(const Eigen::Matrix<double, 3, 6>& rows, const Matrix6& Phi) {
  const Matrix3d turn = Phi.topRightCorner<3, 3>();
  const Matrix3d rest = rows.rightCols<3>().fullPivLu().solve(rows.leftCols<3>());
  const Matrix3d S = turn.transpose() * (Phi.bottomRightCorner<3, 3>() + rest * turn);
  if (!S.allFinite()) return 0;
  const Vector3d eigenvalues =
      Eigen::SelfAdjointEigenSolver<Matrix3d>(0.5 * (S + S.transpose())).eigenvalues();
  return static_cast<int>(
      (eigenvalues.array() < -1e-9 * eigenvalues.cwiseAbs().maxCoeff()).count());
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

class ExactArm::Rod {
 public:
  Rod(const model::Arm& arm, const Load& load, const ExactOptions& options);
  Solution solve(const model::Twists& unloaded) const;
  std::vector<model::CurvePoint<lie::SE3>> curve(const model::Twists& unloaded, int count) const;

 private:
  // The arm shot from given nodes, with all that Newton's method asks for.
  struct Shot {
    std::vector<Node> nodes;
    std::vector<Matrix6> Phi;     // derivative of each segment's end by its start
    std::vector<Vector6> defect;  // what the segment's end misses the next node by; of the last
                                  // one the moment that is left over
    double norm = std::numeric_limits<double>::infinity();
  };
  // The nodes that balance the largest share of the load that was reached.
  struct Reached {
    std::vector<Node> nodes;
    double share = 0.0, residual = 0.0;
    int iterations = 0;
  };
  // What a walk along the arm met.
  struct Trace {
    bool finite = true;
    bool supported = true;
  };

  template <int kColumns>
  Flow<kColumns> flow(int j, const model::Twists& unloaded, double share) const;
  std::vector<Node> unloadedNodes(const model::Twists& unloaded) const;
  Shot shoot(std::vector<Node> nodes, const model::Twists& unloaded, double share) const;
  Step newtonStep(const Shot& shot) const;
  std::vector<Node> moved(const std::vector<Node>& nodes, const Step& step, double factor) const;
  // What newton() makes of the nodes it is given.
  struct Balance {
    bool found = false;
    std::vector<Node> nodes;
    double residual = std::numeric_limits<double>::infinity();
  };
  Balance newton(std::vector<Node> nodes, const model::Twists& unloaded, double share, bool damped,
                 int& iterations) const;
  Reached reach(const model::Twists& unloaded) const;
  // Calls visit(X, turned) with the pose at each of the stops, s over the whole arm that do not
  // decrease, and the integral of the angular strain up to it.
  template <class Visit>
  Trace trace(const Reached& reached, const model::Twists& unloaded,
              const std::vector<double>& stops, const Visit& visit) const;
  void check(const model::Twists& unloaded) const;
  model::Shape unloadedShape(const model::Twists& unloaded) const;

  ExactOptions options_;
  std::vector<SectionLaw> laws_;
  std::vector<Segment> segments_;
  double size_ = 0.0;         // length of the arm [m]
  double force_scale_ = 0.0;  // of all that pulls [N]
  double moment_scale_ = 0.0;
  // False where a moment keeps its direction: it has no energy that tells whether a shape holds.
  bool conservative_ = true;
  double moment_unit_ = 1.0;  // bends the arm by about one radian [N m]
  bool empty_;
};

ExactArm::Rod::Rod(const model::Arm& arm, const Load& load, const ExactOptions& options)
    : options_(options) {
  const int sections = arm.sectionCount();
  load.validate(sections);
  options.validate();
  basics::requireValue(sections * options.pieces_per_section <= model::kMaxPieces, "exact tier",
                       "the number of pieces of all sections",
                       sections * options.pieces_per_section,
                       "at most 128; lower pieces_per_section");
  empty_ = load.empty();

  double bend = 0.0;
  for (int k = 0; k < sections; ++k) {
    const double l = arm.freeLength(k);
    laws_.push_back({complianceOf(arm, load, k), arm.equilibrium(k).null_space});
    size_ += l;
    bend += laws_[k].C.bottomRightCorner<3, 3>().norm();
    force_scale_ += load.mass[k] * load.gravity.norm();
  }
  std::vector<PointLoad> points = load.points;
  std::stable_sort(points.begin(), points.end(), [](const PointLoad& a, const PointLoad& b) {
    return a.section + a.s < b.section + b.s;
  });
  for (const PointLoad& point : points) {
    force_scale_ += load.forceOf(point).norm();
    conservative_ = conservative_ && point.moment.isZero(0);
    moment_scale_ += load.forceOf(point).norm() * point.offset.norm() + point.moment.norm();
  }
  moment_scale_ += force_scale_ * size_;
  moment_unit_ = bend > 0 ? 1.0 / bend : std::max(moment_scale_, 1e-300);

  // From the tip to the base, since a force pulls at all that is before it.
  Vector3d force = Vector3d::Zero();
  std::vector<Segment> backward;
  for (int k = sections - 1; k >= 0; --k) {
    const Vector3d weight = load.mass[k] * load.gravity;
    const double c = laws_[k].C.bottomRightCorner<3, 3>().norm(), l = arm.freeLength(k);
    double end = 1.0;
    while (end > 0) {
      std::vector<Pull> pulls;
      while (!points.empty() && points.back().section + points.back().s >= k + end) {
        const PointLoad& point = points.back();
        pulls.push_back({point.offset, load.forceOf(point), point.moment});
        force += pulls.back().force;
        points.pop_back();
      }
      const double begin = !points.empty() && points.back().section == k ? points.back().s : 0.0;
      const double largest = std::max(force.norm(), (force + (end - begin) * weight).norm());
      const double growth = std::sqrt(c * l * largest) * (end - begin);
      const int parts =
          static_cast<int>(std::clamp(std::ceil(growth / kGrowth), 1.0, 1.0 * kMaxSegments));
      for (int i = parts; i > 0; --i) {
        const auto at = [&](int part) {
          return part == parts ? end : begin + (end - begin) * part / parts;
        };
        backward.push_back(
            {k, at(i - 1), at(i), force, weight, std::move(pulls), std::min(growth / parts, 50.0)});
        pulls.clear();
        force += (at(i) - at(i - 1)) * weight;
      }
      end = begin;
    }
  }
  segments_.assign(std::make_move_iterator(backward.rbegin()),
                   std::make_move_iterator(backward.rend()));
}

template <int kColumns>
Flow<kColumns> ExactArm::Rod::flow(int j, const model::Twists& unloaded, double share) const {
  const Segment& segment = segments_[j];
  // A tenth of the tolerance for each step: there are some ten of them.
  return {
      laws_[segment.section],  segment, unloaded.col(segment.section), share, size_, moment_unit_,
      0.1 * options_.tolerance};
}

std::vector<Node> ExactArm::Rod::unloadedNodes(const model::Twists& unloaded) const {
  std::vector<Node> nodes;
  Quaterniond R_section = Quaterniond::Identity();
  for (std::size_t j = 0; j < segments_.size(); ++j) {
    const Segment& segment = segments_[j];
    if (j > 0 && segment.section != segments_[j - 1].section) {
      R_section = R_section * turn(unloaded.col(segment.section - 1).tail<3>());
    }
    nodes.push_back({R_section * turn(segment.begin * unloaded.col(segment.section).tail<3>()),
                     Vector3d::Zero()});
  }
  return nodes;
}

ExactArm::Rod::Shot ExactArm::Rod::shoot(std::vector<Node> nodes, const model::Twists& unloaded,
                                         double share) const {
  const int count = static_cast<int>(segments_.size());
  Shot shot;
  shot.Phi.resize(count);
  shot.defect.resize(count);
  double square = 0.0;
  for (int j = 0; j < count; ++j) {
    const auto part = flow<6>(j, unloaded, share);
    Flow<6>::State y;
    Matrix6 start = Matrix6::Identity();
    start.bottomRightCorner<3, 3>() *= moment_unit_;
    y << nodes[j].R.coeffs(), nodes[j].m,
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
    Phi.bottomRows<3>() /= moment_unit_;
    shot.Phi[j] = Phi;
    if (j + 1 < count) {
      const Quaterniond R(y[3], y[0], y[1], y[2]);
      shot.defect[j] << turnBetween(nodes[j + 1].R, R), (m - nodes[j + 1].m) / moment_unit_;
    } else {
      shot.defect[j] << Vector3d::Zero(), m / moment_unit_;
    }
    square += shot.defect[j].squaredNorm();
  }
  shot.nodes = std::move(nodes);
  if (std::isfinite(square)) shot.norm = std::sqrt(square);
  return shot;
}

// Rows P x_j = c that the steps x_j must satisfy for all beyond node j to fit, swept from the tip
// to the base; orthonormal, so that what grows towards the tip decays in them.
Step ExactArm::Rod::newtonStep(const Shot& shot) const {
  using Rows = Eigen::Matrix<double, 3, 6>;
  const int count = static_cast<int>(segments_.size());
  std::vector<Rows> P(count);
  std::vector<Vector3d> c(count);
  Rows rows = Rows::Zero();
  rows.rightCols<3>().setIdentity();
  Vector3d right = Vector3d::Zero();
  Step step;
  for (int j = count - 1; j >= 0; --j) {
    right -= rows * shot.defect[j];
    step.unstable += unstableMotions(rows, shot.Phi[j]);
    const Eigen::HouseholderQR<Eigen::Matrix<double, 6, 3>> qr((rows * shot.Phi[j]).transpose());
    const Matrix3d L = qr.matrixQR().topRows<3>().triangularView<Eigen::Upper>().transpose();
    rows = (qr.householderQ() * Eigen::Matrix<double, 6, 3>::Identity()).transpose();
    right = L.triangularView<Eigen::Lower>().solve(right);
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

std::vector<Node> ExactArm::Rod::moved(const std::vector<Node>& nodes, const Step& step,
                                       double factor) const {
  std::vector<Node> out = nodes;
  for (std::size_t j = 0; j < out.size(); ++j) {
    out[j].R = (nodes[j].R * turn(factor * step.x[j].head<3>())).normalized();
    out[j].m += factor * moment_unit_ * step.x[j].tail<3>();
  }
  return out;
}

ExactArm::Rod::Balance ExactArm::Rod::newton(std::vector<Node> nodes, const model::Twists& unloaded,
                                             double share, bool damped, int& iterations) const {
  Balance balance;
  Shot shot = shoot(std::move(nodes), unloaded, share);
  while (std::isfinite(shot.norm)) {
    const Step step = newtonStep(shot);
    const double size = step.size();
    if (!std::isfinite(size)) return balance;
    balance.residual = size;
    if (size <= options_.tolerance) {
      balance.found = step.unstable == 0 || (damped && !conservative_);
      balance.nodes = moved(shot.nodes, step, 1.0);
      return balance;
    }
    if (iterations == options_.max_iterations || (!damped && size > kLargestStep)) return balance;
    ++iterations;
    Shot next = shoot(moved(shot.nodes, step, 1.0), unloaded, share);
    if (damped) {
      for (double factor = 0.5; !(next.norm < (1.0 - 0.5 * factor) * shot.norm); factor *= 0.5) {
        if (factor < 1e-4) return balance;
        next = shoot(moved(shot.nodes, step, factor), unloaded, share);
      }
    } else if (!(next.norm <= std::max(kContraction * shot.norm, 10 * options_.tolerance))) {
      return balance;
    }
    shot = std::move(next);
  }
  return balance;
}

template <class Visit>
ExactArm::Rod::Trace ExactArm::Rod::trace(const Reached& reached, const model::Twists& unloaded,
                                          const std::vector<double>& stops,
                                          const Visit& visit) const {
  Trace out;
  Flow<0>::State y = Flow<0>::State::Zero();
  double h = 1.0 / options_.pieces_per_section;
  std::size_t next = 0;
  for (std::size_t j = 0; j < segments_.size(); ++j) {
    const auto part = flow<0>(static_cast<int>(j), unloaded, reached.share);
    const auto& N = part.law.null_space;
    const auto checkSupport = [&](double s) {
      const Vector6 w = part.wrench(s, y);
      for (int i = 0; i < N.cols(); ++i) {
        const double scale =
            N.col(i).head<3>().norm() * force_scale_ + N.col(i).tail<3>().norm() * moment_scale_;
        out.supported &= std::abs(N.col(i).dot(w)) <=
                         std::max(kNoWork, 10 * options_.tolerance) * reached.share * scale;
      }
    };
    y.head<7>() << reached.nodes[j].R.coeffs(), reached.nodes[j].m;
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
      visit(lie::SE3{Flow<0>::rotation(y), y.segment<3>(7)}, Vector3d(y.tail<3>()));
      ++next;
    }
  }
  return out;
}

model::Shape ExactArm::Rod::unloadedShape(const model::Twists& unloaded) const {
  const int per_section = options_.pieces_per_section;
  model::Shape::Pieces pieces(6, unloaded.cols() * per_section);
  for (int j = 0; j < pieces.cols(); ++j)
    pieces.col(j) = unloaded.col(j / per_section) / per_section;
  return model::Shape(pieces, per_section);
}

void ExactArm::Rod::check(const model::Twists& unloaded) const {
  basics::requireValue(unloaded.cols() == static_cast<int>(laws_.size()), "exact tier",
                       "the number of unloaded twists", unloaded.cols(), "one for each section");
  basics::require(unloaded.allFinite(), "exact tier: a twist of the unloaded arm is not finite");
}

ExactArm::Rod::Reached ExactArm::Rod::reach(const model::Twists& unloaded) const {
  Reached out;
  out.nodes = unloadedNodes(unloaded);
  std::vector<Node> before;
  double share_before = 0.0, load_step = 1.0;
  while (out.share < 1.0) {
    const double target = load_step >= 1.0 - out.share ? 1.0 : out.share + load_step;
    std::vector<Node> guess = out.nodes;
    if (!before.empty()) {
      const double factor = (target - out.share) / (out.share - share_before);
      for (std::size_t j = 0; j < guess.size(); ++j) {
        guess[j].R = out.nodes[j].R * turn(factor * turnBetween(before[j].R, out.nodes[j].R));
        guess[j].m += factor * (out.nodes[j].m - before[j].m);
      }
    }
    const int iterations_before = out.iterations;
    Balance balance = newton(std::move(guess), unloaded, target, false, out.iterations);
    if (balance.found) {
      before = std::exchange(out.nodes, std::move(balance.nodes));
      share_before = std::exchange(out.share, target);
      out.residual = balance.residual;
      if (out.iterations - iterations_before <= 5) load_step *= 2.0;
      continue;
    }
    if (out.iterations == options_.max_iterations) break;
    load_step = 0.5 * (target - out.share);
    if (load_step >= std::max(kLeastLoadStep, kBranchEnd * out.share)) continue;
    // The branch ends here: the arm drops to another shape, if there is one.
    balance = newton(out.nodes, unloaded, 1.0, true, out.iterations);
    if (!balance.found) break;
    out.nodes = std::move(balance.nodes);
    out.residual = balance.residual;
    out.share = 1.0;
  }
  return out;
}

Solution ExactArm::Rod::solve(const model::Twists& unloaded) const {
  check(unloaded);
  Solution solution;
  solution.shape = unloadedShape(unloaded);
  for (int k = 0; k < unloaded.cols(); ++k) {
    solution.tip = solution.tip * lie::SE3::exp(unloaded.col(k));
  }
  if (empty_) return solution;

  const Reached reached = reach(unloaded);
  solution.iterations = reached.iterations;
  solution.residual = reached.residual;
  if (reached.share < 1.0) {
    solution.status = SolveStatus::kNotConverged;
    const Shot shot = shoot(reached.nodes, unloaded, 1.0);
    solution.residual = std::numeric_limits<double>::infinity();
    if (std::isfinite(shot.norm)) solution.residual = newtonStep(shot).size();
  }
  if (reached.share == 0.0) return solution;
  const int per_section = options_.pieces_per_section;
  std::vector<double> stops;
  for (int k = 0; k < unloaded.cols(); ++k) {
    for (int piece = 1; piece < per_section; ++piece) {
      stops.push_back(k + static_cast<double>(piece) / per_section);
    }
    stops.push_back(k + 1.0);
  }
  model::Shape::Pieces pieces(6, unloaded.cols() * per_section);
  lie::SE3 X_start;
  Vector3d turned_start = Vector3d::Zero();
  int piece = 0;
  const Trace found =
      trace(reached, unloaded, stops, [&](const lie::SE3& X, const Vector3d& turned) {
        pieces.col(piece++) = twistNear(X_start.inverse() * X, turned - turned_start);
        X_start = X;
        turned_start = turned;
      });
  if (!found.finite || !pieces.allFinite()) {
    solution.status = SolveStatus::kNotConverged;
    solution.residual = std::numeric_limits<double>::infinity();
    return solution;
  }
  if (!found.supported) solution.status = SolveStatus::kUnsupported;
  solution.shape = model::Shape(pieces, per_section);
  solution.tip = X_start;
  return solution;
}

std::vector<model::CurvePoint<lie::SE3>> ExactArm::Rod::curve(const model::Twists& unloaded,
                                                              int count) const {
  model::requireCurve(count);
  check(unloaded);
  const int sections = static_cast<int>(unloaded.cols());
  const Reached reached = empty_ ? Reached{} : reach(unloaded);
  if (reached.share < 1.0) return model::sampleCurve(solve(unloaded).shape, count);
  std::vector<double> stops;
  for (int i = 0; i < count; ++i) stops.push_back(model::curvePlace(sections, i, count));
  std::vector<model::CurvePoint<lie::SE3>> out;
  out.reserve(count);
  const Trace found = trace(reached, unloaded, stops, [&](const lie::SE3& X, const Vector3d&) {
    out.push_back({stops[out.size()], X});
  });
  return found.finite ? out : model::sampleCurve(solve(unloaded).shape, count);
}

ExactArm::ExactArm(const model::Arm& arm, const Load& load, const ExactOptions& options)
    : rod_(std::make_shared<const Rod>(arm, load, options)) {}

Solution ExactArm::solve(const model::Twists& unloaded) const { return rod_->solve(unloaded); }

std::vector<model::CurvePoint<lie::SE3>> ExactArm::curve(const model::Twists& unloaded,
                                                         int count) const {
  return rod_->curve(unloaded, count);
}

}  // namespace helix_arm::statics
