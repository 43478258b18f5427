#include "helix_arm/statics/workspace.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <queue>
#include <random>
#include <utility>
#include <vector>

#include "basics/fraction.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/batch.hpp"
#include "statics/inverse/box_quadratic.hpp"
#include "statics/inverse/inverse_task.hpp"

namespace helix_arm::statics {
namespace {

// Sizes of pieces: a point takes 20 ns in closed form, up to 0.1 s with sensitivity by the exact
// tier.
constexpr int kBatchPiece = 16384;
constexpr int kClosedFormPiece = 256;
constexpr int kLoadedPiece = 64;
constexpr int kLoadedSensitivityPiece = 8;
constexpr int kExactPiece = 4;
constexpr int kExactSensitivityPiece = 1;

constexpr double kKilopascal = 1e3;   // [Pa]
constexpr double kMillimetre = 1e-3;  // [m]
constexpr double kOnePercentMore = 1.01;

// SplitMix64 (Steele, Lea, Flood 2014): every number of its sequence can be computed directly.
constexpr std::uint64_t kGoldenGamma = 0x9e3779b97f4a7c15;
std::uint64_t mixed(std::uint64_t z) {
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
  z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
  return z ^ (z >> 31);
}

constexpr int kCorners = 1024;
constexpr int kLoadedCorners = 128;
constexpr int kExactCorners = 8;
// Number of candidates per extreme from which the search climbs: half of them the farthest, half
// spread over all. The exact tier climbs only from the best start.
constexpr int kStarts = 64;
constexpr int kLoadedStarts = 24;
constexpr int kMostSteps = 100;
constexpr int kMostExactSteps = 15;
constexpr double kFirstMove = 0.25;      // of the range of the lengths
constexpr double kLeastFraction = 1e-3;  // of a step
constexpr double kSufficient = 1e-4;     // of the gain that the slope predicts
constexpr double kNoGain = 1e-11;        // gain below which the search ends [m]
constexpr double kLeastCurvature = 0.2;  // Powell's, relative to the present curvature

// Limits of branch and bound.
constexpr int kMostBoxes = 4000;         // per extreme
constexpr double kLeastRange = 1e-12;    // of a twist coordinate, relative to the largest
constexpr double kPenalty = 1e4;         // of leaving the reachable twists, relative to the slope
constexpr double kLeastPenalty = 1e-9;   // keeps its Hessian positive definite
constexpr double kBoundRounding = 1e-9;  // relative allowance for rounding in a bound

// Direction of an extent at a tip; for the distance, zero at the base.
Eigen::Vector3d extentDirection(int which, const Eigen::Vector3d& p) {
  if (which < 6) return (which < 3 ? -1 : 1) * Eigen::Vector3d::Unit(which % 3);
  return p.norm() > 0 ? p.normalized() : Eigen::Vector3d::Zero();
}

// Upper bounds of the extents of an arm without load or taper, by branch and bound.
//
// The twists of a section are g = g0 + B y with y in [-1, 1]^m, and y = Z x for lengths x, scaled
// to [-1, 1]^n. m is at most 6 per section, however many the muscles. Over a box of y, the extent
// is at most its linearisation at the centre plus half of the largest second derivative. The
// linear part is maximised over the box and the reachable y = Z x together, through weak duality:
// for any mu, d'y <= max over the box of (d - mu)'y + max over x of mu'Z x. A penalty method gives
// a mu that is nearly the best, and the x of a tip near that maximum.
//
// Second derivative of the tip p = int R v ds + links along a change (dv, dw) of the twists, with
// a(s) = int_0^s |dw|: R' = [phi] R, phi = int R dw, so |R''| <= |phi'| + |phi|^2 <= 3/2 a^2, and
//   |p''| <= int 3/2 a^2 |v| + 2 a |dv| ds + sum 3/2 a^2 |link|.
class ExtentBound {
 public:
  struct Found {
    double extent = -std::numeric_limits<double>::infinity();
    Eigen::VectorXd lengths;
  };

  ExtentBound(const model::Arm& arm, const Eigen::VectorXd& lower, const Eigen::VectorXd& upper)
      : arm_(arm),
        middle_(0.5 * (lower + upper)),
        half_(0.5 * (upper - lower)),
        centre_(arm.twistsOfLengths(middle_)),
        dual_(0) {
    const int n = arm.actuatorCount();
    Eigen::MatrixXd Z(6 * arm.sectionCount(), n);
    Z.setZero();
    int rows = 0;
    for (int k = 0; k < arm.sectionCount(); ++k) {
      first_.push_back(rows);
      const int begin = arm.firstActuator(k), count = arm.firstActuator(k + 1) - begin;
      lie::Vector6 scale = lie::Vector6::Ones();
      scale.tail<3>().setConstant(arm.restLength());  // of an angle, to what it moves
      const Eigen::MatrixXd map =
          scale.asDiagonal() * arm.equilibrium(k).map * half_.segment(begin, count).asDiagonal();
      const Eigen::JacobiSVD<Eigen::MatrixXd> svd(map, Eigen::ComputeFullU);
      const Eigen::MatrixXd y = svd.matrixU().transpose() * map;
      const Eigen::VectorXd range = y.cwiseAbs().rowwise().sum();
      Eigen::Matrix<double, 6, Eigen::Dynamic> B(6, 0);
      for (int j = 0; j < 6; ++j) {
        if (!(range[j] > kLeastRange * range.maxCoeff())) continue;
        B.conservativeResize(6, B.cols() + 1);
        B.col(B.cols() - 1) = range[j] * scale.cwiseInverse().cwiseProduct(svd.matrixU().col(j));
        size_.push_back(range[j]);
        Z.block(rows++, begin, 1, count) = y.row(j) / range[j];
      }
      B_.push_back(B);
    }
    first_.push_back(rows);
    Z_ = Z.topRows(rows);
    dual_ = BoxQuadratic(rows + n);
    dual_.H.setIdentity();
    dual_.H.bottomLeftCorner(n, rows) = -Z_.transpose();
    dual_.H.bottomRightCorner(n, n) = Z_.transpose() * Z_;
    dual_.H.diagonal().array() += kLeastPenalty;
    dual_.lower.setConstant(-1);
    dual_.upper.setConstant(1);
  }

  // A bound on the extent at any lengths, at most `gap` above `found` unless kMostBoxes do not
  // suffice. Replaces `found` by the farthest tip that it meets.
  double search(int which, double gap, Found& found) {
    const auto lower = [](const Box& a, const Box& b) { return a.bound < b.bound; };
    std::priority_queue<Box, std::vector<Box>, decltype(lower)> open(lower);
    const Eigen::Index m = Z_.rows();
    Box all{Eigen::VectorXd::Zero(m), Eigen::VectorXd::Ones(m), 0.0};
    all.bound = boundOf(which, all, gap, found);
    open.push(std::move(all));
    double closed = found.extent;  // largest bound of the boxes that were not split
    for (int boxes = 0; boxes < kMostBoxes && !open.empty(); boxes += 2) {
      if (open.top().bound <= found.extent + gap) break;
      Box box = open.top();
      open.pop();
      int widest = 0;
      for (int j = 1; j < m; ++j) {
        if (size_[j] * box.half[j] > size_[widest] * box.half[widest]) widest = j;
      }
      box.half[widest] *= 0.5;
      for (const double side : {-1.0, 1.0}) {
        Box part = box;
        part.centre[widest] += side * box.half[widest];
        part.bound = std::min(box.bound, boundOf(which, part, gap, found));
        if (part.bound <= found.extent + gap) {
          closed = std::max(closed, part.bound);
        } else {
          open.push(std::move(part));
        }
      }
    }
    if (!open.empty()) closed = std::max(closed, open.top().bound);
    return std::max(closed, found.extent) + kBoundRounding * arm_.restLength();
  }

 private:
  struct Box {
    Eigen::VectorXd centre, half;  // of y
    double bound;                  // on the extent
  };
  // Reach of a box beyond the linear model of its tip [m].
  struct Spread {
    double length;     // no tip is farther from the base
    double moved;      // bound on |p'|
    double curvature;  // bound on |p''| / 2
  };

  Spread spreadOf(const model::Twists& g, const Eigen::VectorXd& half) const {
    Spread out{0.0, 0.0, 0.0};
    double a = 0.0;
    for (int k = 0; k < arm_.sectionCount(); ++k) {
      const lie::Vector6 change =
          B_[k].cwiseAbs() * half.segment(first_[k], first_[k + 1] - first_[k]);
      const double dv = change.head<3>().norm(), dw = change.tail<3>().norm();
      const double v = g.col(k).head<3>().norm() + dv;
      out.length += v;
      out.moved += (a + dw / 2) * v + dv;
      out.curvature += 0.75 * (a * a + a * dw + dw * dw / 3) * v + (a + dw / 2) * dv;
      a += dw;
      const double link = arm_.link(k).translation.norm();
      out.length += link;
      out.moved += a * link;
      out.curvature += 0.75 * a * a * link;
    }
    return out;
  }

  // Derivative (3 x m) of the tip's position by y, base frame.
  Eigen::Matrix3Xd derivative(const model::Twists& g, lie::SE3& tip) const {
    Eigen::Matrix3Xd out(3, Z_.rows());
    tip = lie::SE3();
    for (int k = arm_.sectionCount() - 1; k >= 0; --k) {
      tip = arm_.link(k) * tip;
      const lie::Matrix6 body = tip.inverse().adjoint() * lie::SE3::rightJacobian(g.col(k));
      out.middleCols(first_[k], B_[k].cols()) = (body * B_[k]).topRows<3>();
      tip = lie::SE3::exp(g.col(k)) * tip;
    }
    return tip.rotation * out;
  }

  double boundOf(int which, const Box& box, double gap, Found& found) {
    model::Twists g = centre_;
    for (int k = 0; k < arm_.sectionCount(); ++k) {
      g.col(k) += B_[k] * box.centre.segment(first_[k], first_[k + 1] - first_[k]);
    }
    const Spread spread = spreadOf(g, box.half);
    lie::SE3 tip;
    const Eigen::Matrix3Xd J = derivative(g, tip);
    const Eigen::Vector3d& p = tip.translation;
    const Eigen::VectorXd d = J.transpose() * extentDirection(which, p);
    const auto total = [&](double linear) {
      const double along = WorkspaceExtremes::extent(which, p) + linear;
      if (which < 6) return std::min(along + spread.curvature, spread.length);
      const double far = std::max(along, spread.moved - p.norm());
      return std::min(std::hypot(far, spread.moved) + spread.curvature, spread.length);
    };
    const double least = d.cwiseAbs().dot(box.half);
    const double bound = total(least);
    if (bound <= found.extent + gap || !(d.norm() > 0)) return bound;
    const double linear = std::min(least, dualBound(d, box, which, found));
    // No reachable y is in the box.
    if (linear < -least - kBoundRounding * d.norm()) {
      return -std::numeric_limits<double>::infinity();
    }
    return total(linear);
  }

  // Bound on d'(y - centre) over the reachable y in the box; below the least of the box if none is.
  double dualBound(const Eigen::VectorXd& d, const Box& box, int which, Found& found) {
    const Eigen::Index m = Z_.rows(), n = Z_.cols();
    const double weight = kPenalty * d.norm();
    dual_.g.head(m) = box.centre - d / weight;
    dual_.g.tail(n) = -Z_.transpose() * box.centre;
    dual_.lower.head(m) = -box.half;
    dual_.upper.head(m) = box.half;
    const Eigen::VectorXd& solution = dual_.solve();
    const Eigen::VectorXd x = solution.tail(n);
    const Eigen::VectorXd mu = weight * (box.centre + solution.head(m) - Z_ * x);
    const Eigen::VectorXd lengths = middle_ + half_.cwiseProduct(x.cwiseMax(-1).cwiseMin(1));
    const double extent = WorkspaceExtremes::extent(which, arm_.tipOfLengths(lengths).translation);
    if (extent > found.extent) found = {extent, lengths};
    return (d - mu).cwiseAbs().dot(box.half) + (Z_.transpose() * mu).lpNorm<1>() -
           mu.dot(box.centre);
  }

  const model::Arm& arm_;
  Eigen::VectorXd middle_, half_;  // of the lengths [m]
  model::Twists centre_;           // at the middle of the lengths
  std::vector<Eigen::Matrix<double, 6, Eigen::Dynamic>> B_;
  std::vector<int> first_;    // coordinate y of each section
  std::vector<double> size_;  // motion of the tip by each y, roughly [m]
  Eigen::MatrixXd Z_;         // (m x n)
  BoxQuadratic dual_;
};

class Climber {
 public:
  explicit Climber(const ArmModel& model)
      : model_(model),
        n_(model.arm().actuatorCount()),
        exact_(model.choice().setting.tier == Tier::kExact),
        loaded_(takesLoad(model.choice().setting.tier)),
        box_(model.arm()),
        step_(n_) {}

  WorkspaceExtremes find(WorkspaceExtremes sampled) {
    WorkspaceExtremes out = std::move(sampled);
    const std::vector<Candidate> candidates = converged(candidateInputs());
    for (const Candidate& candidate : candidates) out.add(candidate.tip, candidate.input);
    if (out.empty()) return out;
    for (int which = 0; which < WorkspaceExtremes::kCount; ++which) {
      std::vector<Eigen::VectorXd> starts{out.of(which).input};
      for (const Candidate* candidate : startsOf(candidates, which)) {
        starts.push_back(candidate->input);
      }
      for (const Eigen::VectorXd& start : starts) {
        const Eigen::VectorXd input = climb(which, start);
        const Tip tip = model_.tip(input);
        if (tip.converged()) out.add(tip.tip.translation, input);
      }
    }
    if (model_.isLinear()) certify(out);
    return out;
  }

 private:
  using Candidate = WorkspaceExtremes::Extreme;
  struct Point {
    Eigen::VectorXd lengths, slope;  // slope of the cost
    double cost = std::numeric_limits<double>::infinity();
  };

  // Corners of the limits and, but for the exact tier, as many inputs between them.
  std::vector<Eigen::VectorXd> candidateInputs() const {
    const int most = exact_ ? kExactCorners : loaded_ ? kLoadedCorners : kCorners;
    const bool all = n_ < 31 && (1 << n_) <= most;
    const int corners = all ? 1 << n_ : most;
    const int count = exact_ ? corners : corners + most;
    std::mt19937_64 generator(20240229);
    std::vector<Eigen::VectorXd> out;
    for (int candidate = 0; candidate < count; ++candidate) {
      Eigen::VectorXd input(n_);
      for (int i = 0; i < n_; ++i) {
        const model::Range& limits = model_.arm().actuator(i).limits;
        if (candidate >= corners) {
          const double fraction = basics::fractionOf(generator());
          input[i] =
              std::min(limits.lower + fraction * (limits.upper - limits.lower), limits.upper);
          continue;
        }
        const bool upper = all ? ((candidate >> i) & 1) != 0
                               : candidate == 1 || (candidate > 1 && (generator() >> 63) != 0);
        input[i] = upper ? limits.upper : limits.lower;
      }
      out.push_back(std::move(input));
    }
    return out;
  }

  std::vector<Candidate> converged(std::vector<Eigen::VectorXd> inputs) const {
    std::vector<Candidate> out;
    for (Eigen::VectorXd& input : inputs) {
      const Tip tip = model_.tip(input);
      if (tip.converged()) out.push_back({std::move(input), tip.tip.translation});
    }
    return out;
  }

  std::vector<const Candidate*> startsOf(const std::vector<Candidate>& candidates,
                                         int which) const {
    std::vector<const Candidate*> out;
    if (exact_) return out;
    for (const Candidate& candidate : candidates) out.push_back(&candidate);
    const std::size_t half = (loaded_ ? kLoadedStarts : kStarts) / 2;
    if (out.size() <= 2 * half) return out;
    std::partial_sort(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(half), out.end(),
                      [which](const Candidate* a, const Candidate* b) {
                        return WorkspaceExtremes::extent(which, a->tip) >
                               WorkspaceExtremes::extent(which, b->tip);
                      });
    for (std::size_t i = 0; i < half; ++i) {
      out[half + i] = &candidates[i * candidates.size() / half];
    }
    out.resize(2 * half);
    return out;
  }

  // Bounds the extents, and climbs from farther tips that the search for the bounds meets.
  void certify(WorkspaceExtremes& out) {
    ExtentBound bound(model_.arm(), box_.lower(), box_.upper());
    for (int which = 0; which < WorkspaceExtremes::kCount; ++which) {
      ExtentBound::Found found{WorkspaceExtremes::extent(which, out.of(which).tip), {}};
      const double gap = WorkspaceExtremes::kCertified * out.reach();
      const double highest = bound.search(which, gap, found);
      if (found.lengths.size() > 0) {
        const Eigen::VectorXd input = climb(which, inputsOf(found.lengths, out.of(which).input));
        out.add(model_.tip(input).tip.translation, input);
      }
      out.bound(which, highest);
    }
  }

  void evaluate(int which, Point& point) const {
    const TipResponse response = model_.tipResponse(point.lengths);
    point.cost = std::numeric_limits<double>::infinity();
    if (response.status != SolveStatus::kConverged) return;
    const Eigen::Vector3d& p = response.tip.translation;
    const Eigen::Vector3d direction = extentDirection(which, p);
    point.cost = -WorkspaceExtremes::extent(which, p);
    point.slope =
        -(response.by.topRows<3>().transpose() * (response.tip.rotation.transpose() * direction));
  }

  // Climbs to a local maximum of the extent, from inputs within the limits.
  Eigen::VectorXd climb(int which, const Eigen::VectorXd& start) {
    Point point{model_.arm().lengths(start), {}}, next;
    evaluate(which, point);
    if (!std::isfinite(point.cost)) return start;
    const double range = (box_.upper() - box_.lower()).maxCoeff();
    const double first = std::max(point.slope.norm(), std::numeric_limits<double>::min());
    Eigen::MatrixXd curvature = Eigen::MatrixXd::Identity(n_, n_) * (first / (kFirstMove * range));
    for (int i = 0; i < (exact_ ? kMostExactSteps : kMostSteps); ++i) {
      step_.H = curvature;
      step_.g = point.slope;
      step_.lower = (box_.lower() - point.lengths).cwiseMin(0);
      step_.upper = (box_.upper() - point.lengths).cwiseMax(0);
      const Eigen::VectorXd step = step_.solve();
      const double slope = point.slope.dot(step);
      if (!(slope < -kNoGain)) break;
      double fraction = 1;
      for (; fraction > kLeastFraction; fraction *= 0.5) {
        next.lengths =
            (point.lengths + fraction * step).cwiseMax(box_.lower()).cwiseMin(box_.upper());
        evaluate(which, next);
        if (next.cost <= point.cost + kSufficient * fraction * slope) break;
      }
      if (!(fraction > kLeastFraction)) break;
      update(next.lengths - point.lengths, next.slope - point.slope, curvature);
      std::swap(point, next);
    }
    return inputsOf(point.lengths, start);
  }

  // BFGS update, damped to stay positive definite (Powell 1978).
  static void update(const Eigen::VectorXd& moved, Eigen::VectorXd turned,
                     Eigen::MatrixXd& curvature) {
    const Eigen::VectorXd expected = curvature * moved;
    const double along = moved.dot(expected);
    if (!(along > 0)) return;
    const double seen = moved.dot(turned);
    if (seen < kLeastCurvature * along) {
      const double share = (1 - kLeastCurvature) * along / (along - seen);
      turned = share * turned + (1 - share) * expected;
    }
    curvature +=
        turned * turned.transpose() / moved.dot(turned) - expected * expected.transpose() / along;
  }

  Eigen::VectorXd inputsOf(const Eigen::VectorXd& lengths, const Eigen::VectorXd& guess) const {
    Eigen::VectorXd input = guess;
    box_.readInputs(lengths, input);
    return input;
  }

  const ArmModel& model_;
  int n_;
  bool exact_, loaded_;
  LengthBox box_;
  BoxQuadratic step_;
};

}  // namespace

Workspace::Workspace(const ArmModel& model, const WorkspaceOptions& options)
    : model_(model), options_(options) {
  batch_ = !takesLoad(model_.choice().setting.tier);
  if (!options_.sensitivity) return;
  for (int i = 0; i < model_.arm().actuatorCount(); ++i) {
    const model::Actuator& actuator = model_.arm().actuator(i);
    basics::require(model::isPressure(actuator.drive), "sensitivity: it is per kPa, and ",
                    actuator.name, " is a tendon; leave it out");
  }
  for (const model::Stiffness& factors : {model::Stiffness{kOnePercentMore, 1.0, 1.0},
                                          {1.0, kOnePercentMore, 1.0},
                                          {1.0, 1.0, kOnePercentMore}}) {
    stiffer_.push_back(model_.scaledStiffness(factors));
  }
  if (!model_.load() || model_.load()->empty()) return;
  stiffer_.push_back(model_.scaledStiffness({1.0, 1.0, 1.0}, kOnePercentMore));
}

int Workspace::pieceSize() const {
  const bool sensitivity = options_.sensitivity;
  if (batch_) return sensitivity ? kClosedFormPiece : kBatchPiece;
  if (model_.choice().setting.tier == Tier::kExact) {
    return sensitivity ? kExactSensitivityPiece : kExactPiece;
  }
  return sensitivity ? kLoadedSensitivityPiece : kLoadedPiece;
}

Eigen::MatrixXd Workspace::drawInputs(std::uint64_t first, int count) const {
  const int n = model_.arm().actuatorCount();
  const std::uint64_t start = mixed(options_.seed + kGoldenGamma);
  Eigen::MatrixXd inputs(count, n);
  for (int i = 0; i < n; ++i) {
    const model::Range& limits = model_.arm().actuator(i).limits;
    for (int row = 0; row < count; ++row) {
      const std::uint64_t place = (first + row) * n + i + 1;
      const double fraction = basics::fractionOf(mixed(start + place * kGoldenGamma));
      // Rounding may exceed the limit.
      inputs(row, i) =
          std::min(limits.lower + fraction * (limits.upper - limits.lower), limits.upper);
    }
  }
  return inputs;
}

Eigen::RowVector3d Workspace::sensitivityAt(const Eigen::VectorXd& q,
                                            const Eigen::Vector3d& tip) const {
  const model::Arm& arm = model_.arm();
  const TipResponse response = model_.tipResponse(arm.lengths(q));
  // Without a derivative, nothing bounds it.
  if (response.status != SolveStatus::kConverged) {
    return Eigen::RowVector3d::Constant(std::numeric_limits<double>::infinity());
  }
  // Not rotated to the base frame, which would not change their lengths.
  const auto moves = response.by.topRows<3>().eval();
  double pressure = 0.0, stiffness = 0.0;
  for (int i = 0; i < q.size(); ++i) {
    pressure += (arm.actuator(i).contraction.slopeInside(q[i]) * moves.col(i)).squaredNorm();
  }
  for (const ArmModel& model : stiffer_) {
    const Tip found = model.tip(q);
    if (!found.converged()) stiffness = std::numeric_limits<double>::infinity();
    stiffness += (found.tip.translation - tip).squaredNorm();
  }
  return {kKilopascal * std::sqrt(pressure), kMillimetre * moves.norm(), std::sqrt(stiffness)};
}

WorkspacePoints Workspace::sample(std::uint64_t first, int count) const {
  WorkspacePoints out;
  out.inputs = drawInputs(first, count);
  out.tips.resize(count, 3);
  if (batch_) {
    std::vector<const double*> columns;
    for (int i = 0; i < out.inputs.cols(); ++i) columns.push_back(out.inputs.col(i).data());
    model::TipBatch(model_.arm())
        .columns(columns.data(), static_cast<std::size_t>(count), out.tips.col(0).data(),
                 out.tips.col(1).data(), out.tips.col(2).data());
    if (!options_.sensitivity) return out;
  }
  if (options_.sensitivity) out.sensitivity.resize(count, kSensitivities);
  int kept = 0;
  for (int row = 0; row < count; ++row) {
    const Eigen::VectorXd q = out.inputs.row(row);
    Eigen::Vector3d tip = out.tips.row(row);
    if (!batch_) {
      const Tip found = model_.tip(q);
      if (!found.converged()) continue;
      tip = found.tip.translation;
    }
    if (options_.sensitivity) {
      const Eigen::RowVector3d sensitivity = sensitivityAt(q, tip);
      if (!sensitivity.allFinite()) continue;
      out.sensitivity.row(kept) = sensitivity;
    }
    out.inputs.row(kept) = q;
    out.tips.row(kept) = tip;
    ++kept;
  }
  out.unbalanced = count - kept;
  out.inputs.conservativeResize(kept, Eigen::NoChange);
  out.tips.conservativeResize(kept, Eigen::NoChange);
  if (options_.sensitivity) out.sensitivity.conservativeResize(kept, Eigen::NoChange);
  return out;
}

double WorkspaceExtremes::extent(int which, const Eigen::Vector3d& tip) {
  if (which == 6) return tip.norm();
  return which < 3 ? -tip[which] : tip[which - 3];
}

void WorkspaceExtremes::add(const Eigen::Vector3d& tip, const model::InputRef& input) {
  for (int which = 0; which < kCount; ++which) {
    if (!empty_ && !(extent(which, tip) > extent(which, found_[which].tip))) continue;
    found_[which] = {input, tip};
  }
  empty_ = false;
}

void WorkspaceExtremes::add(const WorkspacePoints& points) {
  if (points.count() == 0) return;
  for (int which = 0; which < kCount; ++which) {
    const double sign = which < 3 ? -1 : 1;
    Eigen::Index row = 0;
    (which == 6 ? points.tips.rowwise().squaredNorm().eval()
                : (sign * points.tips.col(which % 3)).eval())
        .maxCoeff(&row);
    add(points.tips.row(row).transpose(), points.inputs.row(row).transpose());
  }
}

Eigen::AlignedBox3d WorkspaceExtremes::bounds() const {
  Eigen::AlignedBox3d box;
  for (int which = 0; which < kCount && !empty_; ++which) box.extend(found_[which].tip);
  return box;
}

Eigen::AlignedBox3d WorkspaceExtremes::outerBounds() const {
  return {-bounds_.head<3>(), bounds_.segment<3>(3)};
}

double WorkspaceExtremes::reach() const { return empty_ ? 0.0 : extent(6, found_[6].tip); }

WorkspaceExtremes findExtremes(const ArmModel& model, WorkspaceExtremes sampled) {
  return Climber(model).find(std::move(sampled));
}

}  // namespace helix_arm::statics
