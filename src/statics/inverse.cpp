#include "helix_arm/statics/inverse.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>

#include "box_quadratic.hpp"
#include "helix_arm/basics/fraction.hpp"
#include "helix_arm/model/curve.hpp"
#include "inverse_task.hpp"

namespace helix_arm::statics {
namespace {

constexpr int kSeedCount = 1024;
constexpr int kNearestStarts = 12;    // of the seeds
constexpr int kCornerStarts = 10;     // then of the limits' corners; later ones are spread over all
constexpr int kMostLoadedStarts = 6;  // each takes a thousand times as long as without load
constexpr int kMaxActuatorsForCorners = 6;
constexpr double kGoalFraction =
    0.1;  // aim below the tolerance: room for rounding on the way to inputs
constexpr double kMapRankTolerance = 1e-9;
constexpr double kSnapFraction = 1e-2;   // of the tolerance: closer to a limit is at it
constexpr double kAtRest = 1e-13;        // relative decrease that is no longer worth a step
constexpr double kLeastDamping = 1e-12;  // relative to the mean of diag(J'J)
// A residual this small, of the arm's length, is a near miss; where the linear model promises to
// take this share of its square away, the target may well be reached.
constexpr double kNearMiss = 1e-2;
constexpr double kValleyPromise = 0.5;
constexpr double kValleyGain = 0.9;  // a step along a valley leaves less of the squared residual
constexpr int kValleyDescent = 25;   // iterations from a step back to the valley's floor
constexpr int kValleyBudget = 6000;  // iterations in valleys for one target
constexpr int kLoadedValleyBudget = 60;
constexpr double kPreferenceAtRest =
    1e-7;  // steps of the preference, relative to the range of the lengths
constexpr double kLeastStepFraction = 0.01;
constexpr double kPreferenceWeight =
    1e-8;  // of the preference against the task, relative to diag(J'J)

void requirePositive(const char* name, double value) {
  if (std::isfinite(value) && value > 0) return;
  throw std::invalid_argument("InverseOptions::" + std::string(name) + " is " +
                              std::to_string(value) + "; expected a finite value > 0");
}

// Farther away the arm would vanish in the rounding of the distance.
template <class Target>
void requireNear(const char* what, const Target& target) {
  if (target.cwiseAbs().maxCoeff() <= kFarthestTarget) return;
  throw std::invalid_argument("the target " + std::string(what) +
                              " is not finite, or has an entry beyond " +
                              std::to_string(kFarthestTarget) + " m or rad");
}

}  // namespace

class InverseSolver::Workspace {
 public:
  Workspace(const model::Arm& arm, const ArmModel* loaded, const InverseOptions& options);

  void aimAt(const Eigen::Vector3d& position) noexcept;
  void aimAt(const lie::SE3& pose) noexcept;
  void aimAt(const model::Twists& twists) noexcept;
  const InverseResult& solve(const model::InputRef& start);
  const model::Arm& arm() const { return arm_; }

 private:
  enum class Descent { kReached, kAtRest, kExhausted };
  // A point of the search with everything that is known there.
  struct Point {
    Eigen::VectorXd lengths, residual;
    Eigen::MatrixXd jacobian;
    double cost = 0.0;  // squared norm of the residual [m^2]
  };

  void checkStart(const model::InputRef& start) const;
  void evaluate(Point& point) const noexcept;
  void buildNormalEquations(const Point& point) noexcept;
  template <int kRows>
  void sumNormalEquations(const Point& point) noexcept;
  void setStepBounds(const Point& point) noexcept;
  bool takeNewtonStep(Point& point) noexcept;
  Descent descend(Point& point, int most_iterations) noexcept;
  double proposeStep(const Point& point, double damping) noexcept;
  Descent followValley(Point& point, Descent before) noexcept;
  Descent tryOtherStarts(Descent first) noexcept;
  void sampleSeeds();
  int nearestSeed(int count) const noexcept;
  int nextSeed(int start_number) noexcept;
  void snapToLimits() noexcept;
  void readInputs(const Eigen::VectorXd& lengths) noexcept;
  double preferenceCost() const noexcept;
  bool improvePreference() noexcept;
  void followPreference() noexcept;
  bool hasSpareActuators() const;
  void report(Descent outcome) noexcept;

  const model::Arm& arm_;
  const ArmModel* loaded_;  // where a load bends it, else null
  InverseOptions options_;
  InverseTask task_;
  int n_;
  int map_rank_ = 0;                                 // independent motions of all sections together
  Eigen::VectorXd at_lower_limit_, at_upper_limit_;  // lengths at the limits of the inputs [m]
  Eigen::VectorXd lower_, upper_;                    // of the lengths [m]
  Eigen::VectorXd reference_;                        // q_ref of the preference
  Eigen::VectorXd input_;  // inputs of the current lengths, also the guess for the next ones
  Eigen::VectorXd preference_slope_;  // d((q - q_ref) / range) / dl
  Eigen::VectorXd tangent_, base_lengths_, base_input_;
  Point current_, trial_, best_;
  bool answered_ = false;  // current_ is the last answer, to a target of this kind
  BoxQuadratic step_;
  Eigen::MatrixXd normal_;  // J'J, lower triangle
  double scale_ = 1.0;      // mean of its diagonal
  int valley_budget_ = 0;   // iterations left for this target
  Eigen::MatrixXd seeds_;   // (n x seeds) lengths [m]
  int corners_ = 0;         // of the limits: the first of the seeds
  std::vector<lie::SE3> seed_tips_;
  std::vector<char> seed_used_;
  InverseResult result_;
};

InverseSolver::Workspace::Workspace(const model::Arm& arm, const ArmModel* loaded,
                                    const InverseOptions& options)
    : arm_(arm),
      loaded_(loaded),
      options_(options),
      task_(arm, loaded, options.rotation_weight),
      n_(arm.actuatorCount()),
      at_lower_limit_(n_),
      at_upper_limit_(n_),
      lower_(n_),
      upper_(n_),
      reference_(n_),
      input_(n_),
      preference_slope_(n_),
      tangent_(n_),
      base_lengths_(n_),
      base_input_(n_),
      step_(n_),
      normal_(n_, n_) {
  requirePositive("position_tolerance", options.position_tolerance);
  requirePositive("rotation_weight", options.rotation_weight);
  requirePositive("max_iterations", options.max_iterations);
  requirePositive("max_starts", options.max_starts);
  if (loaded != nullptr) options_.max_starts = std::min(options_.max_starts, kMostLoadedStarts);
  if (!(options.cocontraction >= 0 && options.cocontraction <= 1)) {
    throw std::invalid_argument("InverseOptions::cocontraction is " +
                                std::to_string(options.cocontraction) +
                                "; expected a fraction in [0, 1]");
  }
  for (int i = 0; i < n_; ++i) {
    const model::Actuator& actuator = arm.actuator(i);
    at_lower_limit_[i] = actuator.contraction.length(actuator.limits.lower);
    at_upper_limit_[i] = actuator.contraction.length(actuator.limits.upper);
  }
  lower_ = at_lower_limit_.cwiseMin(at_upper_limit_);
  upper_ = at_lower_limit_.cwiseMax(at_upper_limit_);
  for (int k = 0; k < arm.sectionCount(); ++k) {
    // Of the map, not of A: an untilted ring can shear and twist, but its muscles cannot make it.
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(arm.equilibrium(k).map);
    qr.setThreshold(kMapRankTolerance);
    map_rank_ += static_cast<int>(qr.rank());
  }
  for (Point* point : {&current_, &trial_, &best_}) {
    point->lengths.resize(n_);
    point->residual.resize(task_.maxRows());
    point->jacobian.resize(task_.maxRows(), n_);
  }
  result_.input.resize(n_);
  result_.limits.resize(n_);
  sampleSeeds();
}

void InverseSolver::Workspace::sampleSeeds() {
  corners_ = n_ <= kMaxActuatorsForCorners ? 1 << n_ : 0;
  seeds_.resize(n_, kSeedCount + corners_);
  std::mt19937_64 generator(20240229);
  for (int s = 0; s < seeds_.cols(); ++s) {
    for (int i = 0; i < n_; ++i) {
      const bool corner = s < corners_;
      const double fraction = corner ? (s >> i) & 1 : basics::fractionOf(generator());
      seeds_(i, s) = lower_[i] + fraction * (upper_[i] - lower_[i]);
    }
    // Starts are ranked by these: for that the loaded tier serves, and the exact one is not needed.
    const bool loaded = loaded_ != nullptr && loaded_->choice().setting.tier == Tier::kLoaded;
    seed_tips_.push_back(loaded ? loaded_->tipOfLengths(seeds_.col(s)).tip
                                : model::tipPose(arm_.twistsOfLengths(seeds_.col(s))));
  }
  seed_used_.resize(seeds_.cols());
}

// Of the first `count` seeds that have not been used, the one with its tip nearest to the target;
// -1 where there is none.
int InverseSolver::Workspace::nearestSeed(int count) const noexcept {
  int choice = -1;
  double least = std::numeric_limits<double>::infinity();
  for (int s = 0; s < count; ++s) {
    if (seed_used_[s]) continue;
    const double error = task_.squaredErrorOfTip(seed_tips_[s]);
    if (error < least) {
      least = error;
      choice = s;
    }
  }
  return choice;
}

int InverseSolver::Workspace::nextSeed(int start_number) noexcept {
  if (start_number == 0) std::fill(seed_used_.begin(), seed_used_.end(), 0);
  const int count = static_cast<int>(seeds_.cols());
  int choice = -1;
  if (start_number < kNearestStarts) {
    choice = nearestSeed(count);
  } else if (start_number < kNearestStarts + kCornerStarts) {
    choice = nearestSeed(corners_);
  }
  if (choice < 0) choice = std::max(0, start_number - kNearestStarts) * 97 % count;
  seed_used_[choice] = 1;
  return choice;
}

void InverseSolver::Workspace::checkStart(const model::InputRef& start) const {
  if (start.size() != n_) {
    throw std::invalid_argument("the start has " + std::to_string(start.size()) +
                                " inputs; the arm has " + std::to_string(n_) + " actuators");
  }
  for (int i = 0; i < n_; ++i) {
    if (!arm_.actuator(i).limits.contains(start[i])) {
      throw std::invalid_argument("the start is outside the limits of " + arm_.actuator(i).name +
                                  ": " + std::to_string(start[i]));
    }
  }
}

void InverseSolver::Workspace::evaluate(Point& point) const noexcept {
  task_.evaluate(point.lengths, point.residual, point.jacobian);
  point.cost = point.residual.head(task_.rows()).squaredNorm();
}

template <int kRows>
void InverseSolver::Workspace::sumNormalEquations(const Point& point) noexcept {
  const Eigen::Index rows = task_.rows();
  double trace = 0.0;
  for (int i = 0; i < n_; ++i) {
    const auto column = point.jacobian.col(i).head<kRows>(rows);
    for (int j = 0; j <= i; ++j)
      normal_(i, j) = column.dot(point.jacobian.col(j).head<kRows>(rows));
    trace += normal_(i, i);
    step_.g[i] = column.dot(point.residual.head<kRows>(rows));
  }
  scale_ = trace / n_ + std::numeric_limits<double>::min();
}

void InverseSolver::Workspace::buildNormalEquations(const Point& point) noexcept {
  // A position has three rows: a size known here is worth a tenth of a solution's time.
  task_.rows() == 3 ? sumNormalEquations<3>(point) : sumNormalEquations<Eigen::Dynamic>(point);
}

void InverseSolver::Workspace::setStepBounds(const Point& point) noexcept {
  for (int i = 0; i < n_; ++i) {
    step_.lower[i] = lower_[i] - point.lengths[i];
    step_.upper[i] = upper_[i] - point.lengths[i];
  }
}

// Three muscles and a position: the square system is solved as it is, a third of the work of its
// normal equations. False where that would leave the box or does not gain much, which is for the
// damped steps to sort out.
bool InverseSolver::Workspace::takeNewtonStep(Point& point) noexcept {
  const Eigen::Matrix3d J = point.jacobian.topRows<3>();
  const Eigen::Vector3d a = J.col(0), b = J.col(1), c = J.col(2), r = point.residual.head<3>();
  const Eigen::Vector3d bc = b.cross(c),
                        rows = Eigen::Vector3d(bc.dot(r), c.cross(a).dot(r), a.cross(b).dot(r));
  trial_.lengths = point.lengths - rows / a.dot(bc);
  const bool inside = (trial_.lengths.array() >= lower_.array()).all() &&
                      (trial_.lengths.array() <= upper_.array()).all();
  if (!inside) return false;
  evaluate(trial_);
  if (!(trial_.cost < 0.1 * point.cost)) return false;
  std::swap(point, trial_);
  return true;
}

// The damped step of the normal equations into trial_.lengths; returns the decrease of the cost
// that the linear model of the residual promises.
double InverseSolver::Workspace::proposeStep(const Point& point, double damping) noexcept {
  for (int a = 0; a < n_; ++a) {
    for (int b = 0; b < a; ++b) step_.H(a, b) = normal_(a, b);
    step_.H(a, a) = normal_(a, a) + damping * scale_;
  }
  const Eigen::VectorXd& delta = step_.solve();
  double promised = 0.0;
  for (int a = 0; a < n_; ++a) {
    double row = 0.5 * normal_(a, a) * delta[a];
    for (int b = 0; b < a; ++b) row += normal_(a, b) * delta[b];
    promised -= 2.0 * delta[a] * (step_.g[a] + row);
    trial_.lengths[a] = std::min(std::max(point.lengths[a] + delta[a], lower_[a]), upper_[a]);
  }
  return promised;
}

// Levenberg-Marquardt inside the box, from a point evaluated to the goal or to a local minimum.
InverseSolver::Workspace::Descent InverseSolver::Workspace::descend(Point& point,
                                                                    int most_iterations) noexcept {
  const double goal = std::pow(kGoalFraction * options_.position_tolerance, 2);
  // A residual that no step shortens by a thousandth of the tolerance is as short as it gets.
  const double rest_gain = 2e-3 * options_.position_tolerance;
  double damping = kLeastDamping;
  bool fresh = true;
  bool newton = n_ == 3 && task_.rows() == 3 && !hasSpareActuators();
  for (int i = 0; i < most_iterations; ++i) {
    if (point.cost <= goal) return Descent::kReached;
    ++result_.iterations;
    if (newton) {
      newton = takeNewtonStep(point);
      if (newton) continue;
    }
    if (fresh) {
      buildNormalEquations(point);
      setStepBounds(point);
    }
    const double promised = proposeStep(point, damping);
    if (promised <= std::max(kAtRest * point.cost, rest_gain * std::sqrt(point.cost))) {
      return Descent::kAtRest;
    }
    evaluate(trial_);
    const double ratio = (point.cost - trial_.cost) / promised;
    fresh = ratio > 1e-3;
    if (fresh) {
      std::swap(point, trial_);
      damping = std::max(ratio > 0.75   ? 0.1 * damping
                         : ratio < 0.25 ? 4.0 * damping
                                        : damping,
                         kLeastDamping);
    } else {
      damping = std::max(8.0 * damping, 1e-4);
    }
  }
  return point.cost <= goal ? Descent::kReached : Descent::kExhausted;
}

// A section that closes to a circle hardly moves its tip when the circle turns about its start: a
// narrow valley, bent so much that a descent creeps along it. Steps as far along it as the linear
// model wants, falls back to its floor, and compares only there.
InverseSolver::Workspace::Descent InverseSolver::Workspace::followValley(Point& point,
                                                                         Descent before) noexcept {
  const double near = kNearMiss * arm_.restLength();
  if (before == Descent::kReached || point.cost > near * near) return before;
  bool gained = true;
  while (gained && valley_budget_ > 0) {
    buildNormalEquations(point);
    setStepBounds(point);
    if (proposeStep(point, kLeastDamping) < kValleyPromise * point.cost) return before;
    tangent_ = trial_.lengths - point.lengths;
    base_lengths_ = point.lengths;
    const double cost = point.cost;
    gained = false;
    for (double fraction = 1.0; !gained && fraction > kLeastStepFraction; fraction *= 0.5) {
      point.lengths = base_lengths_ + fraction * tangent_;
      evaluate(point);
      const int iterations = result_.iterations;
      if (descend(point, kValleyDescent) == Descent::kReached) return Descent::kReached;
      valley_budget_ -= 1 + result_.iterations - iterations;
      gained = point.cost < kValleyGain * cost;
    }
    if (gained) continue;
    point.lengths = base_lengths_;
    evaluate(point);
  }
  return gained ? Descent::kExhausted : before;
}

void InverseSolver::Workspace::aimAt(const Eigen::Vector3d& position) noexcept {
  answered_ = answered_ && task_.kind() == InverseTask::Kind::kPosition;
  if (answered_) current_.residual.head<3>() += task_.position() - position;
  task_.setPosition(position);
}

void InverseSolver::Workspace::aimAt(const lie::SE3& pose) noexcept {
  answered_ = false;
  task_.setPose(pose);
}

void InverseSolver::Workspace::aimAt(const model::Twists& twists) noexcept {
  answered_ = false;
  task_.setTwists(twists);
}

const InverseResult& InverseSolver::Workspace::solve(const model::InputRef& start) {
  checkStart(start);
  result_.iterations = 0;
  // Along a path the start is the last answer: its tip and Jacobian are still at hand.
  const bool at_hand = answered_ && start == input_;
  for (int i = 0; i < n_; ++i) {
    const model::Actuator& actuator = arm_.actuator(i);
    const model::Range& limits = actuator.limits;
    if (!at_hand) current_.lengths[i] = actuator.contraction.lengthInside(start[i]);
    input_[i] = start[i];
    const double fraction =
        options_.preference == Preference::kCocontraction ? options_.cocontraction : 0.0;
    reference_[i] = options_.preference == Preference::kMinChange
                        ? start[i]
                        : limits.lower + fraction * (limits.upper - limits.lower);
  }
  if (at_hand) {
    current_.cost = current_.residual.head<3>().squaredNorm();
  } else {
    evaluate(current_);
  }
  Descent outcome = descend(current_, options_.max_iterations);
  // Twists are linear in the lengths: their least squares has one minimum. Tips may hide theirs
  // behind another.
  if (outcome != Descent::kReached && task_.kind() != InverseTask::Kind::kTwists) {
    valley_budget_ = loaded_ != nullptr ? kLoadedValleyBudget : kValleyBudget;
    outcome = followValley(current_, outcome);
    if (outcome != Descent::kReached) outcome = tryOtherStarts(outcome);
  }
  readInputs(current_.lengths);
  if (outcome == Descent::kReached && hasSpareActuators()) followPreference();
  snapToLimits();
  report(outcome);
  answered_ = result_.status == InverseStatus::kReached;
  return result_;
}

// The best of the starts, left in current_. It counts as at rest where any start as good came to
// rest.
InverseSolver::Workspace::Descent InverseSolver::Workspace::tryOtherStarts(Descent first) noexcept {
  const double infinity = std::numeric_limits<double>::infinity();
  double rest_cost = first == Descent::kAtRest ? current_.cost : infinity;
  std::swap(best_, current_);
  for (int s = 0; s < options_.max_starts; ++s) {
    current_.lengths = seeds_.col(nextSeed(s));
    evaluate(current_);
    const Descent descent = followValley(current_, descend(current_, options_.max_iterations));
    if (descent == Descent::kReached) return descent;
    if (descent == Descent::kAtRest) rest_cost = std::min(rest_cost, current_.cost);
    if (current_.cost < best_.cost) std::swap(best_, current_);
  }
  std::swap(best_, current_);
  const bool at_rest =
      std::sqrt(rest_cost) <= std::sqrt(current_.cost) + options_.position_tolerance;
  return at_rest ? Descent::kAtRest : Descent::kExhausted;
}

bool InverseSolver::Workspace::hasSpareActuators() const {
  return n_ > std::min(task_.rows(), map_rank_);
}

// An actuator that ends within rounding of a limit is at it.
void InverseSolver::Workspace::snapToLimits() noexcept {
  const double near = kSnapFraction * options_.position_tolerance;
  bool snapped = false;
  for (int i = 0; i < n_; ++i) {
    for (const double bound : {lower_[i], upper_[i]}) {
      if (current_.lengths[i] == bound || std::abs(current_.lengths[i] - bound) > near) continue;
      current_.lengths[i] = bound;
      snapped = true;
    }
  }
  if (!snapped) return;
  readInputs(current_.lengths);
  evaluate(current_);
}

void InverseSolver::Workspace::readInputs(const Eigen::VectorXd& lengths) noexcept {
  for (int i = 0; i < n_; ++i) {
    const model::Actuator& actuator = arm_.actuator(i);
    const model::Range& limits = actuator.limits;
    // A length at its bound is the limit itself, to the last bit.
    if (lengths[i] == at_lower_limit_[i]) {
      input_[i] = limits.lower;
    } else if (lengths[i] == at_upper_limit_[i]) {
      input_[i] = limits.upper;
    } else {
      const double q = actuator.contraction.inverseInside(lengths[i], input_[i]);
      input_[i] = std::min(std::max(q, limits.lower), limits.upper);
    }
  }
}

double InverseSolver::Workspace::preferenceCost() const noexcept {
  double cost = 0.0;
  for (int i = 0; i < n_; ++i) {
    const model::Range& limits = arm_.actuator(i).limits;
    const double u = (input_[i] - reference_[i]) / (limits.upper - limits.lower);
    cost += u * u;
  }
  return cost;
}

// Goes along the inputs that reach the target towards the preferred ones, until they are the best
// of them.
void InverseSolver::Workspace::followPreference() noexcept {
  for (int i = 0; i < options_.max_iterations && improvePreference(); ++i) ++result_.iterations;
}

// One step: to the least preference cost on the tangent of the target's solutions, then back onto
// them.
bool InverseSolver::Workspace::improvePreference() noexcept {
  const double before = preferenceCost();
  buildNormalEquations(current_);
  setStepBounds(current_);
  double mean_weight = 0.0;
  for (int i = 0; i < n_; ++i) {
    const model::Actuator& actuator = arm_.actuator(i);
    const double range = actuator.limits.upper - actuator.limits.lower;
    const double mean_slope = (upper_[i] - lower_[i]) / range;
    // Where the contraction is flat a length says nothing of its input: the slope is kept away from
    // zero.
    const double slope = actuator.contraction.slopeInside(input_[i]);
    const double kept = std::copysign(std::max(std::abs(slope), 1e-3 * mean_slope), slope);
    preference_slope_[i] = 1.0 / (kept * range);
    mean_weight += preference_slope_[i] * preference_slope_[i] / n_;
  }
  const double weight = kPreferenceWeight * scale_ / mean_weight;
  for (int a = 0; a < n_; ++a) {
    const model::Range& limits = arm_.actuator(a).limits;
    const double u = (input_[a] - reference_[a]) / (limits.upper - limits.lower);
    for (int b = 0; b < a; ++b) step_.H(a, b) = normal_(a, b);
    step_.H(a, a) = normal_(a, a) + weight * preference_slope_[a] * preference_slope_[a];
    step_.g[a] += weight * preference_slope_[a] * u;
  }
  tangent_ = step_.solve();
  if ((tangent_.array().abs() <= kPreferenceAtRest * (upper_ - lower_).array()).all()) return false;
  base_lengths_ = current_.lengths;
  base_input_ = input_;
  for (double fraction = 1.0; fraction > kLeastStepFraction; fraction *= 0.5) {
    current_.lengths = (base_lengths_ + fraction * tangent_).cwiseMax(lower_).cwiseMin(upper_);
    evaluate(current_);
    if (descend(current_, options_.max_iterations) != Descent::kReached) continue;
    readInputs(current_.lengths);
    if (preferenceCost() < before) return true;
  }
  current_.lengths = base_lengths_;
  input_ = base_input_;
  evaluate(current_);
  return false;
}

void InverseSolver::Workspace::report(Descent outcome) noexcept {
  result_.status = outcome == Descent::kReached  ? InverseStatus::kReached
                   : outcome == Descent::kAtRest ? InverseStatus::kUnreachable
                                                 : InverseStatus::kNotConverged;
  result_.input = input_;
  result_.residual = std::sqrt(current_.cost);
  if (result_.residual <= options_.position_tolerance) result_.status = InverseStatus::kReached;
  result_.position_error = task_.kind() == InverseTask::Kind::kPosition ? result_.residual
                           : task_.kind() == InverseTask::Kind::kPose
                               ? current_.residual.head<3>().norm()
                               : task_.positionError(current_.lengths);
  for (int i = 0; i < n_; ++i) {
    const model::Range& limits = arm_.actuator(i).limits;
    const double margin = 1e-9 * (limits.upper - limits.lower);
    result_.limits[i] = input_[i] <= limits.lower + margin   ? Limit::kLower
                        : input_[i] >= limits.upper - margin ? Limit::kUpper
                                                             : Limit::kNone;
  }
  if (result_.residual < kNoBalance) return;
  result_.status = InverseStatus::kNotConverged;
  result_.residual = result_.position_error = std::numeric_limits<double>::infinity();
}

InverseSolver::InverseSolver(const model::Arm& arm, const InverseOptions& options)
    : workspace_(std::make_unique<Workspace>(arm, nullptr, options)) {}
InverseSolver::InverseSolver(const ArmModel& model, const InverseOptions& options)
    : workspace_(std::make_unique<Workspace>(
          model.arm(), takesLoad(model.choice().setting.tier) ? &model : nullptr, options)) {}
InverseSolver::~InverseSolver() = default;
InverseSolver::InverseSolver(InverseSolver&&) noexcept = default;
InverseSolver& InverseSolver::operator=(InverseSolver&&) noexcept = default;

const InverseResult& InverseSolver::toPosition(const Eigen::Vector3d& position,
                                               const model::InputRef& start) {
  requireNear("position", position);
  workspace_->aimAt(position);
  return workspace_->solve(start);
}

const InverseResult& InverseSolver::toPose(const lie::SE3& pose, const model::InputRef& start) {
  requireNear("position", pose.translation);
  const Eigen::Matrix3d& R = pose.rotation;
  if (!((R * R.transpose() - Eigen::Matrix3d::Identity()).norm() <= 1e-6 && R.determinant() > 0)) {
    throw std::invalid_argument("the target's rotation is not orthogonal and right-handed");
  }
  workspace_->aimAt(pose);
  return workspace_->solve(start);
}

const InverseResult& InverseSolver::toTwists(const model::Twists& twists,
                                             const model::InputRef& start) {
  const int sections = workspace_->arm().sectionCount();
  if (twists.cols() != sections) {
    throw std::invalid_argument("got twists of " + std::to_string(twists.cols()) +
                                " sections; the arm has " + std::to_string(sections));
  }
  requireNear("twists", twists);
  workspace_->aimAt(twists);
  return workspace_->solve(start);
}

}  // namespace helix_arm::statics
