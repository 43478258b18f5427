#include "helix_arm/tracking/onset_hypotheses.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/localization/gaussian.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/tracking/error_budget.hpp"

namespace helix_arm::estimation {
namespace {

constexpr char kCulprit[] = "contact";
constexpr int kOnsetPeriod = 3;       // pictures
constexpr int kLeastAge = 2;          // pictures that an onset must have before its score counts
constexpr double kArmingTime = 10.0;  // of pictures [s]
constexpr double kLongestGap = 0.3;   // between pictures; a longer one counts as this [s]
constexpr double kSureTip = 0.003;    // [m]
constexpr double kGone = 7.8;         // 95 % point of chi-square, 3 degrees
constexpr double kGoneTime = 0.5;     // [s]
constexpr double kDetermined = 3.0;   // standard deviations
constexpr int kMostOutliers = 2;      // consecutive; a third one is another force
constexpr double kPlaceLead = 4.5;    // of log likelihoods
// Constants of drifts, in time of pictures [s].
constexpr double kMemoryPeriod = 3.0;
constexpr double kLongestMemory = 60.0;
// Fewer that are contradicted begin anew: the arm was not yet at rest when they were made.
constexpr std::size_t kLeastMemories = 3;
constexpr double kForceTime = 0.5;  // in which the estimate of a new force settles
constexpr double kDoubtTime = 0.5;  // within it a sudden force is usually found

constexpr double kLeastDrift = 0.005;  // [m]
// Constants of QuietScore: time in which a force is found [s], and part of a still arm's motion at
// rest.
constexpr double kFindTime = 0.5, kResting = 0.4;

// Young onsets detect what begins now; few old ones are kept: they are certain of no force.
bool isKept(std::int64_t age, std::int64_t number) {
  if (age <= 12) return true;
  if (age <= 48) return number % 4 == 0;
  return age < 192 && number % 16 == 0;
}

Eigen::Matrix3Xd determinedDirections(const Eigen::Vector3d& force,
                                      const Eigen::Matrix3d& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(covariance);
  Eigen::Matrix3Xd out(3, 0);
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d axis = axes.eigenvectors().col(i);
    const double variance = axes.eigenvalues()[i], along = axis.dot(force);
    if (along * along <= kDetermined * kDetermined * variance) continue;
    out.conservativeResize(3, out.cols() + 1);
    out.rightCols<1>() = along < 0 ? Eigen::Vector3d(-axis) : axis;
  }
  return out;
}

/// A copy of a filter's state with a constant force on the arm from then on: [theta; b; f].
struct OnsetState : Gaussian {
  /// @param watch  [theta; b]. @param deviation  standard deviation of each entry of f [N].
  OnsetState(const Gaussian& watch, double deviation) {
    const Eigen::Index size = watch.mean.size();
    mean = Eigen::VectorXd::Zero(size + 3);
    mean.head(size) = watch.mean;
    covariance = Eigen::MatrixXd::Zero(size + 3, size + 3);
    covariance.topLeftCorner(size, size) = watch.covariance;
    covariance.diagonal().tail<3>().setConstant(deviation * deviation);
  }

  /// Prediction between two pictures. @param creep  of the force [N s^-1/2].
  void predict(const ArmFilter::Step& step, double creep) {
    growBias(step.bias_growth);
    renewForce(creep * std::sqrt(step.dt));
  }

  /// The force may be another one by this much [N].
  void renewForce(double deviation) {
    covariance.diagonal().tail<3>().array() += deviation * deviation;
  }

  /// Adds to the covariance of b, (d x d).
  void growBias(const Eigen::MatrixXd& growth) {
    const Eigen::Index d = growth.rows(), begin = mean.size() - 3 - d;
    covariance.block(begin, begin, d, d) += growth;
  }

  /// The onset's expectation of a picture, linear about the step's theta.
  /// @param by_force  (d x 3) change of the measured twists with f.
  Measurement expect(const ArmFilter::Step& step, const Eigen::MatrixXd& by_force) const {
    const Eigen::Index parameters = step.theta.size(), d = step.measured.size();
    Eigen::MatrixXd H(d, parameters + d + 3);
    H << step.model.by_theta, Eigen::MatrixXd::Identity(d, d), by_force;
    Eigen::VectorXd from = mean;
    from.head(parameters) -= step.theta;
    return {step.measured - step.model.twists - H * from, H, step.noise};
  }

  Eigen::Vector3d force() const { return mean.tail<3>(); }  // [N]
  Eigen::Matrix3d forceCovariance() const { return covariance.bottomRightCorner<3, 3>(); }

  /// f' P_ff^-1 f, about twice the log likelihood ratio of a force against none.
  double score() const {
    return force().dot(Eigen::LDLT<Eigen::Matrix3d>(forceCovariance()).solve(force()));
  }

  /// [theta; b].
  Gaussian withoutForce() const {
    const Eigen::Index size = mean.size() - 3;
    return {mean.head(size), covariance.topLeftCorner(size, size)};
  }
};

}  // namespace

void OnsetOptions::validate() const {
  basics::requirePositive(kCulprit, "the limit of the score", limit);
  basics::requirePositive(kCulprit, "the deviation of forces [N]", deviation);
  basics::requireNotNegative(kCulprit, "the creep of forces [N s^-1/2]", creep);
}

struct OnsetHypotheses::Workspace {
  struct Onset {
    OnsetState state;
    OnsetState origin;  // the same without the pictures since then
    double time;        // [s]
    std::int64_t number, picture;
    bool agrees;  // the pictures with what was known of the arm
  };
  // A force at one position of the arm.
  struct Hypothesis {
    OnsetState state;
    double log_likelihood;
  };

  // Detects the onset of a contact. @param motion  as of see().
  void search(double time, double motion, ArmFilter& watch, TipCompliance& compliance, bool armed) {
    const ArmFilter::Step& step = *watch.lastStep();
    const Eigen::MatrixXd by_force = compliance.atTip()(watch.rows(), Eigen::all);
    std::size_t best = 0;
    load.score = 0.0;
    for (std::size_t i = 0; i < onsets.size(); ++i) {
      Onset& onset = onsets[i];
      for (OnsetState* one : {&onset.origin, &onset.state}) {
        one->predict(step, creep);
        one->growBias(step.play_growth);
      }
      onset.state.update(onset.state.expect(step, by_force));
      const double score = onset.state.score();
      if (pictures - onset.picture < kLeastAge || score <= load.score) continue;
      best = i;
      load.score = score;
    }
    load.score /= std::max(1.0, motion * motion);
    if (armed && !ignores && load.score > options.limit) {
      // The onset before the one that found the force is not affected by it.
      begin(onsets[best], onsets[best > 0 ? best - 1 : 0].origin, compliance.places().size());
      watch.setState(hypotheses.back().state.withoutForce());
      return;
    }
    const auto tooOld = [this](const Onset& onset) {
      return !isKept(pictures - onset.picture, onset.number);
    };
    onsets.erase(std::remove_if(onsets.begin(), onsets.end(), tooOld), onsets.end());
    if (pictures % kOnsetPeriod == 0) {
      const OnsetState onset(watch.state(), deviation);
      const bool agrees = !beyond && !drift.doubtful;
      onsets.push_back({onset, onset, time, pictures / kOnsetPeriod, pictures, agrees});
    }
  }

  // Notes a picture in which a contact could have begun. @param motion  as of see().
  // @param along  unit vector along the tip.
  void noteQuiet(double time, double dt, double motion, const Eigen::Vector3d& along) {
    quiet.highest = std::max(quiet.highest, load.score);
    const auto onset = std::find_if(onsets.begin(), onsets.end(), [time](const Onset& one) {
      return time - one.time <= kFindTime;
    });
    if (onset == onsets.end() || motion >= kResting) return;
    const Eigen::Vector3d side = along.unitOrthogonal();
    Eigen::Matrix<double, 3, 2> across;
    across << side, along.cross(side);
    const Eigen::Matrix2d information =
        across.transpose() * onset->state.forceCovariance().inverse() * across;
    const double weakest =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(information).eigenvalues().minCoeff();
    quiet.seconds += dt;
    quiet.unit_force += dt / quiet.seconds * (1.0 / std::sqrt(weakest) - quiet.unit_force);
  }

  void begin(const Onset& found, const OnsetState& before, std::size_t places) {
    hypotheses.assign(places, {before, 0.0});
    load.contact = true;
    load.onset = found.time;
    agreed_at_onset = found.agrees;
    outliers = 0;
    gone_since.reset();
    onsets.clear();
  }

  // Estimates magnitude and position of the force, and detects its end.
  void follow(double time, const ArmFilter::Step& step, const std::vector<int>& rows,
              TipCompliance& compliance) {
    for (Hypothesis& hypothesis : hypotheses) hypothesis.state.predict(step, creep);
    if (!isUsable(step, compliance.atTip()(rows, Eigen::all))) return;
    for (std::size_t i = 0; i < hypotheses.size(); ++i) {
      Hypothesis& hypothesis = hypotheses[i];
      const auto picture = hypothesis.state.expect(step, compliance.at(i)(rows, Eigen::all));
      hypothesis.log_likelihood += hypothesis.state.logLikelihood(picture);
      hypothesis.state.update(picture);
    }
    load.score = hypotheses.back().state.score();
    if (load.score >= kGone) {
      gone_since.reset();
    } else if (!gone_since || time < *gone_since) {  // or the clock was set back
      gone_since = time;
    }
    load.contact = !gone_since || time - *gone_since < kGoneTime;
  }

  // A single outlier is ignored; several in a row indicate another force.
  bool isUsable(const ArmFilter::Step& step, const Eigen::MatrixXd& by_force) {
    const OnsetState& tip = hypotheses.back().state;
    if (tip.distance2(tip.expect(step, by_force)) <=
        outlierLimit(static_cast<int>(by_force.rows()))) {
      outliers = 0;
      return true;
    }
    if (outliers == 0) agreed_at_onset = drift.allowed > 0 && !beyond && !drift.doubtful;
    if (++outliers <= kMostOutliers) return false;
    outliers = 0;
    renewed = true;
    for (Hypothesis& hypothesis : hypotheses) hypothesis.state.renewForce(deviation);
    return true;
  }

  std::size_t likeliest() const {
    std::size_t best = 0;
    for (std::size_t i = 1; i < hypotheses.size(); ++i) {
      if (hypotheses[i].log_likelihood > hypotheses[best].log_likelihood) best = i;
    }
    return best;
  }

  void report(TipCompliance& compliance) {
    const double score = load.score, onset = load.onset;
    const bool contact = load.contact;
    load = {};
    load.score = score;
    load.normalised = compliance.normalised();
    load.blind = !compliance.complete();
    if (!contact) return;
    load.contact = true;
    load.onset = onset;
    const std::size_t place = likeliest();
    const auto isClose = [&](const Hypothesis& other) {
      return hypotheses[place].log_likelihood - other.log_likelihood < kPlaceLead;
    };
    const bool named =
        hypotheses.size() > 1 && std::count_if(hypotheses.begin(), hypotheses.end(), isClose) == 1;
    if (named) load.place = compliance.places()[place];
    const OnsetState& force = (named ? hypotheses[place] : hypotheses.back()).state;
    const double unit = load.normalised ? TipCompliance::kTypicalStiffness : 1.0;
    load.force = force.force() / unit;
    load.covariance = force.forceCovariance() / (unit * unit);
    load.determined = determinedDirections(load.force, load.covariance);
    const Eigen::Vector3d known = load.determined * (load.determined.transpose() * force.force());
    load.tip_beyond_fit = compliance.tipBeyondFit(named ? place : hypotheses.size() - 1) * known;
  }

  // A force explains what the pictures show if they agreed with what was known when it began. While
  // it acts, they are compared with what was known under it; afterwards, without it.
  void explain(double dt) {
    since_change += dt;
    if (load.contact == touched && !renewed) return;
    touched = load.contact;
    renewed = false;
    explained = touched && agreed_at_onset;
    since_change = 0.0;
    if (!explained) return;
    const auto underAnother = [](const Memory& memory) { return memory.touched; };
    memories.erase(std::remove_if(memories.begin(), memories.end(), underAnother), memories.end());
    drift.doubtful = beyond = false;
    against = 0.0;
  }

  // A picture is beyond what is allowed if it contradicts more than half of the memories: some are
  // of moments at which the arm was not as the filter assumes. What is allowed must not grow during
  // a doubt, which would end by waiting alone.
  void compare(const model::Shape& measured, bool settled, const ArmFilter& watch,
               TipCompliance& compliance) {
    const ArmFilter::Step& step = *watch.lastStep();
    const double dt = std::min(step.dt, kLongestGap);
    const Eigen::MatrixXd by_force = compliance.atTip()(watch.rows(), Eigen::all);
    std::vector<Drift> all;
    for (Memory& memory : memories) {
      memory.age += dt;
      if (!drift.doubtful) memory.state.predict(step, 0.0);
      if (memory.touched != explained) continue;
      all.push_back(driftSince(memory, measured, watch.rows(), step, by_force));
    }
    const bool doubtful = drift.doubtful;
    drift = {};
    if (!all.empty()) {
      const auto middle = all.begin() + (static_cast<std::ptrdiff_t>(all.size()) - 1) / 2;
      std::nth_element(all.begin(), middle, all.end(), [](const Drift& a, const Drift& b) {
        return a.distance * b.allowed < b.distance * a.allowed;
      });
      drift = *middle;
    }
    beyond = drift.distance > drift.allowed;
    if (beyond && !explained && all.size() < kLeastMemories) {
      memories.clear();
      beyond = false;
    }
    if (beyond == doubtful) {
      against = 0.0;
    } else if (settled) {
      against += dt;
    }
    drift.doubtful = against < kDoubtTime ? doubtful : beyond;
    if (drift.doubtful != doubtful) against = 0.0;
  }

  void remember(bool sure, const ArmFilter& watch) {
    if (beyond || drift.doubtful) return;
    const auto tooOld = [](const Memory& memory) { return memory.age > kLongestMemory; };
    memories.erase(std::remove_if(memories.begin(), memories.end(), tooOld), memories.end());
    const bool due = memories.empty() || memories.back().touched != touched ||
                     memories.back().age >= kMemoryPeriod;
    if (!sure || !due || touched != explained || since_change < kForceTime) return;
    const OnsetState known = touched ? hypotheses.back().state : OnsetState(watch.state(), 0.0);
    memories.push_back({known, 0.0, touched});
  }

  // Past knowledge of the arm; takes no later pictures.
  struct Memory {
    OnsetState state;
    double age;    // in time of pictures [s]
    bool touched;  // with a force
  };

  // How far the tip of a picture is from the one that a memory of the arm expects.
  static Drift driftSince(const Memory& memory, const model::Shape& measured,
                          const std::vector<int>& rows, const ArmFilter::Step& step,
                          const Eigen::MatrixXd& by_force) {
    Gaussian::Measurement picture = memory.state.expect(step, by_force);
    picture.noise = step.picture_noise;
    model::Twists expected = measured.twists();
    expected.reshaped()(rows) -= picture.innovation;
    const int size = 6 * measured.sectionCount();
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
    covariance(rows, rows) =
        picture.H * memory.state.covariance * picture.H.transpose() + picture.noise;
    const Eigen::Vector3d error =
        model::tipPose(measured).translation - model::tipPose(measured.about(expected)).translation;
    const TipDistance distance = tipDistance(error, tipCovariance(measured, covariance));
    Drift out;
    out.distance = error.norm();
    out.allowed =
        std::max(kLeastDrift, out.distance * std::sqrt(distance.limit / distance.squared));
    out.age = memory.age;
    return out;
  }

  OnsetOptions options;
  double deviation = 0.0, creep = 0.0;  // of forces on this arm [N], [N s^-1/2]
  bool ignores = false;                 // contacts
  QuietScore quiet;
  std::vector<Onset> onsets;           // oldest first
  std::vector<Hypothesis> hypotheses;  // during contact, one per position; the last is the tip
  std::int64_t pictures = 0;
  double seen_time = 0.0;
  int outliers = 0;  // consecutive, during contact
  std::optional<double> gone_since;
  ExternalLoad load;
  std::vector<Memory> memories;  // oldest first
  bool touched = false;          // contact at the last picture
  bool agreed_at_onset = true;   // the pictures, when the force began
  bool renewed = false;          // another force acts
  bool explained = false;        // a force explains what is measured
  double since_change = 0.0;     // of contact [s]
  double against = 0.0;          // pictures that contradict `drift.doubtful` [s]
  bool beyond = false;           // the last picture contradicts a memory
  Drift drift;
};

OnsetHypotheses::OnsetHypotheses(const OnsetOptions& options)
    : work_(std::make_unique<Workspace>()) {
  options.validate();
  work_->options = options;
}
OnsetHypotheses::~OnsetHypotheses() = default;
OnsetHypotheses::OnsetHypotheses(OnsetHypotheses&&) noexcept = default;
OnsetHypotheses& OnsetHypotheses::operator=(OnsetHypotheses&&) noexcept = default;

void OnsetHypotheses::see(double time, double tip_deviation, const model::Shape& measured,
                          bool settled, double motion, ArmFilter& watch,
                          TipCompliance& compliance) {
  Workspace& w = *work_;
  const bool sure = tip_deviation < kSureTip;
  // For a soft arm they are small in proportion. Otherwise a force at its tip would be expected to
  // move it more than one at its base does, and an arm that stays would look held at its base.
  const double softness = compliance.stiffness() / TipCompliance::kTypicalStiffness;
  w.deviation = softness * w.options.deviation;
  w.creep = softness * w.options.creep;
  ++w.pictures;
  w.seen_time += std::min(watch.lastStep()->dt, kLongestGap);
  if (w.load.contact) {
    w.follow(time, *watch.lastStep(), watch.rows(), compliance);
    watch.setState(w.hypotheses.back().state.withoutForce());
    if (!w.load.contact) w.hypotheses.clear();
  } else {
    const bool armed = w.seen_time >= kArmingTime && sure;
    w.search(time, motion, watch, compliance, armed);
    if (armed) {
      w.noteQuiet(time, std::min(watch.lastStep()->dt, kLongestGap), motion,
                  model::tipPose(measured).rotation.col(0));
    }
  }
  w.report(compliance);
  w.explain(std::min(watch.lastStep()->dt, kLongestGap));
  w.compare(measured, settled, watch, compliance);
  w.remember(w.seen_time >= kArmingTime && sure, watch);
}

void OnsetHypotheses::growBias(const Eigen::MatrixXd& covariance, ArmFilter& watch) {
  for (Workspace::Onset& onset : work_->onsets) {
    onset.state.growBias(covariance);
    onset.origin.growBias(covariance);
  }
  for (Workspace::Hypothesis& hypothesis : work_->hypotheses) hypothesis.state.growBias(covariance);
  for (Workspace::Memory& memory : work_->memories) memory.state.growBias(covariance);
  Gaussian state = watch.state();
  state.covariance.bottomRightCorner(covariance.rows(), covariance.cols()) += covariance;
  watch.setState(state);
}

void OnsetHypotheses::reset() {
  Workspace fresh;
  fresh.options = work_->options;
  fresh.ignores = work_->ignores;
  fresh.quiet = work_->quiet;
  *work_ = std::move(fresh);
}

void OnsetHypotheses::ignoreContacts(bool ignores) {
  work_->ignores = ignores;
  if (ignores) work_->quiet = {};
}

const QuietScore& OnsetHypotheses::quiet() const { return work_->quiet; }
const ExternalLoad& OnsetHypotheses::load() const { return work_->load; }
const Drift& OnsetHypotheses::drift() const { return work_->drift; }

}  // namespace helix_arm::estimation
