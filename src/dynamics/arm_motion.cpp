#include "helix_arm/dynamics/arm_motion.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/arm_response.hpp"
#include "helix_arm/statics/loaded.hpp"

namespace helix_arm::dynamics {
namespace {

using basics::require;

constexpr double kSameTime = 1e-9;  // rounding of a time that is a row's and of `at`, in steps
constexpr int kMostParts = 256;     // into which a step is divided that finds no solution

using Moving = std::variant<MovingArmOf<lie::SE3>, MovingArmOf<lie::SE2>>;

Moving movingOf(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                const std::optional<statics::Load>& load, const MotionConfig& config) {
  const bool has_mass =
      load && std::any_of(load->mass.begin(), load->mass.end(), [](double m) { return m > 0; });
  require(has_mass, "motion needs load.mass_kg, which needs arm.stiffness.K_eps_n");
  if (planar && statics::inPlane(*load)) return MovingArmOf<lie::SE2>(*planar, *load, config);
  return MovingArmOf<lie::SE3>(arm, *load, config);
}

void check(const InputSeries& series, const model::Arm& arm) {
  require(!series.time.empty() && series.input.cols() == arm.actuatorCount() &&
              series.input.rows() == static_cast<Eigen::Index>(series.time.size()),
          "a motion needs rows of inputs, each with its time and one input per actuator");
  for (std::size_t row = 0; row < series.time.size(); ++row) {
    const double time = series.time[row];
    require(std::isfinite(time) && (row == 0 || time > series.time[row - 1]), "row ", row + 1,
            " of the inputs is at ", time, " s; expected a later time than that of the row before");
    const Eigen::VectorXd input = series.input.row(static_cast<Eigen::Index>(row));
    for (int i = 0; i < input.size(); ++i) {
      const model::Actuator& actuator = arm.actuator(i);
      const model::DriveUnit unit = model::unitOf(actuator.drive);
      require(actuator.limits.contains(input[i]), "row ", row + 1, " of the inputs has ",
              input[i] / unit.scale, " ", unit.shown, " for ", actuator.name, "; expected ",
              actuator.limits.lower / unit.scale, " to ", actuator.limits.upper / unit.scale, " ",
              unit.shown);
    }
  }
}

template <class Group>
class Driver final : public ArmDriver {
 public:
  Driver(const model::Arm& arm, const MovingArmOf<Group>& moving)
      : moving_(moving), motion_(moving), response_(arm), input_(arm.actuatorCount()) {}

  void start(const Eigen::VectorXd& input, const Beginning& beginning) override {
    response_.restart();
    response_.step(input, 0.0);
    last_ = moving_.arm().twists(response_.effective());
    if (const auto* state = std::get_if<MotionState>(&beginning)) {
      motion_.startAt(last_, *state);
    } else if (std::get<Start>(beginning) == Start::kRest) {
      motion_.startAtRest(last_);
    } else {
      motion_.startStraight(last_);
    }
    summary_ = {0, motion_.energy()};
  }

  void advance(double dt, const Eigen::VectorXd& from, const Eigen::VectorXd& to) override {
    const double parts = std::ceil(dt / moving_.config().step - kSameTime);
    const double count = std::max(1.0, parts);
    for (double i = 0; i < count; ++i) {
      // A lag takes the mean, which makes an error of second order.
      input_ = from + (i + 0.5) / count * (to - from);
      response_.step(input_, dt / count);
      input_ = response_.effective();
      for (int j = 0; j < input_.size(); ++j) {
        if (response_.state(j).response().instant()) {
          input_[j] = from[j] + (i + 1) / count * (to[j] - from[j]);
        }
        const model::Range& limits = moving_.arm().actuator(j).limits;
        input_[j] = std::clamp(input_[j], limits.lower, limits.upper);  // but for rounding, it is
      }
      twists_ = moving_.arm().twists(input_);
      step(dt / count);
    }
    summary_.steps += static_cast<long>(count);
    summary_.energy = motion_.energy();
  }

  MotionState state() const override { return {motion_.position(), motion_.rate()}; }
  lie::SE3 tip() const override { return lie::inSpace(motion_.tip()); }
  const MotionSummary& summary() const override { return summary_; }

 private:
  // One step, or as few as find a solution.
  void step(double dt) {
    const model::TwistsOf<Group> from = last_;
    for (int parts = 1, done = 0; parts <= kMostParts; parts *= 2, done *= 2) {
      while (done < parts) {
        const double share = (done + 1.0) / parts;
        if (!motion_.step(dt / parts, from + share * (twists_ - from))) break;
        ++done;
      }
      if (done == parts) break;
      if (parts == kMostParts)
        throw std::runtime_error("a step found no solution; make dynamics.step_s shorter");
    }
    last_ = twists_;
  }

  const MovingArmOf<Group>& moving_;
  MotionOf<Group> motion_;
  model::ArmResponse response_;
  Eigen::VectorXd input_;
  model::TwistsOf<Group> twists_, last_;
  MotionSummary summary_;
};

template <class Group>
std::unique_ptr<ArmDriver> makeDriver(const model::Arm& arm, const MovingArmOf<Group>& moving) {
  return std::make_unique<Driver<Group>>(arm, moving);
}

// Forces on the coordinates by the inputs (n x actuators) [1/Pa].
template <class Group>
Eigen::MatrixXd forcesByInput(const MovingArmOf<Group>& moving, const Eigen::VectorXd& input) {
  const model::ArmOf<Group>& arm = moving.arm();
  const auto unloaded = arm.unloaded(input);
  Eigen::MatrixXd out(moving.coordinates(), arm.actuatorCount());
  Eigen::VectorXd by_input(moving.coordinates());
  model::TwistsOf<Group> twists = model::TwistsOf<Group>::Zero(Group::kDof, arm.sectionCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const auto by_length = arm.pieceByLengths(k, 0, unloaded);
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      twists.col(k) = by_length.col(i - arm.firstActuator(k)) *
                      arm.actuator(i).contraction.slopeInside(input[i]);
      moving.setTwists(twists, by_input);
      out.col(i).noalias() = moving.stiffness() * by_input;
    }
    twists.col(k).setZero();
  }
  return out;
}

template <class Group>
LinearMotion linearisedFor(const MovingArmOf<Group>& moving, const Eigen::VectorXd& input) {
  MotionOf<Group> motion(moving);
  motion.startAtRest(moving.arm().twists(input));
  LinearMotion out = motion.linearised();
  out.by_input = forcesByInput(moving, input);
  return out;
}

}  // namespace

ArmMotion::ArmMotion(const model::Arm& arm, const std::optional<model::PlanarArm>& planar,
                     const std::optional<statics::Load>& load, const MotionConfig& config)
    : arm_(arm), moving_(movingOf(arm, planar, load, config)) {}

std::unique_ptr<ArmDriver> ArmMotion::driver() const {
  return std::visit([this](const auto& moving) { return makeDriver(arm_, moving); }, moving_);
}

MotionSummary ArmMotion::follow(const InputSeries& series, const Beginning& beginning,
                                const std::vector<double>& at, const Sink& sink) const {
  check(series, arm_);
  const std::unique_ptr<ArmDriver> driver = this->driver();
  Eigen::VectorXd input = series.input.row(0), next = input;
  driver->start(input, beginning);
  const double same =
      kSameTime * std::visit([](const auto& moving) { return moving.config().step; }, moving_);
  double time = series.time.front();
  std::size_t row = 1;
  for (std::size_t i = 0; i < at.size(); ++i) {
    while (at[i] > time + same) {
      require(row < series.time.size(), "a tip is asked for at ", at[i],
              " s, after the last row of the inputs");
      const double end = series.time[row];
      const double until = at[i] < end - same ? at[i] : end;
      const double share = (until - time) / (end - time);
      next = input + share * (series.input.row(static_cast<Eigen::Index>(row)).transpose() - input);
      driver->advance(until - time, input, next);
      input = next;
      time = until;
      if (until == end) ++row;
    }
    if (!sink(i, driver->tip())) break;
  }
  return driver->summary();
}

LinearMotion ArmMotion::linearisedAt(const Eigen::VectorXd& input) const {
  return std::visit([&](const auto& moving) { return linearisedFor(moving, input); }, moving_);
}

}  // namespace helix_arm::dynamics
