#pragma once

#include <Eigen/Core>
#include <atomic>
#include <future>
#include <memory>
#include <vector>

#include "helix_arm/calibration/suspects.hpp"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/rig_memory.hpp"
#include "helix_arm/tracking/arm_filter.hpp"

namespace helix_arm::procedures {

/// Names the usual mistakes of a rig while its loop runs: exchanged channels, a muscle that leaks
/// or gets no pressure.
///
/// Keeps captures of the loop's pictures, spread over the pressures, and tries the fault hypotheses
/// of estimation::suspectsOf() on them: those of the pressures that change them by more than
/// stiffness, lengths and strokes of a sound arm do. While any explains them, the loop distrusts
/// its model.
///
///     if (watch.see(loop, loop.picture(..))) show(textsOf(watch.suspects()));
class SuspectWatch {
 public:
  explicit SuspectWatch(const io::Scene& scene);
  /// Stops a search, and waits for its thread.
  ~SuspectWatch();
  SuspectWatch(SuspectWatch&&) noexcept = default;

  /// After each picture. Begins a search in a thread of its own once enough is new.
  /// @param observation  what the loop made of the picture.
  /// @param waits        for that search, so that the same pictures give the same suspects.
  /// @return whether a search has ended.
  bool see(follow::VisualServo& loop, const estimation::Observation& observation,
           bool waits = false);
  /// Best first; none of an arm that moves about as its scene says.
  const std::vector<estimation::Suspect>& suspects() const { return suspects_; }
  /// Whether captures of enough different pressures have shown that it does.
  bool isSound() const { return sound_; }

 private:
  void note(const follow::VisualServo& loop);
  bool isStill(double time, const Eigen::VectorXd& pressure);
  void keep(const estimation::ArmFilter::Input& picture);
  void search();
  double distance(const Eigen::VectorXd& one, const Eigen::VectorXd& other) const;

  estimation::ArmCaptures arm_;  // without captures
  statics::ArmModel model_;
  estimation::ArmFilterOptions expected_;           // how a sound arm may differ from the scene
  Eigen::VectorXd range_;                           // of the pressures (n) [Pa]
  std::vector<estimation::ArmFilter::Input> kept_;  // by ascending time
  Eigen::VectorXd held_;
  double held_since_ = 0.0, searched_at_ = 0.0;  // [s]
  int new_ = 0;                                  // captures since the last search
  bool sound_ = false, changed_ = false;
  std::vector<estimation::Suspect> suspects_;
  std::shared_ptr<std::atomic<bool>> stop_ = std::make_shared<std::atomic<bool>>(false);
  std::future<std::vector<estimation::Suspect>> running_;  // its end waits for the thread
};

/// The camera or the base that has moved, as a suspect.
estimation::Suspect suspectOf(const estimation::BaseMove& move);

}  // namespace helix_arm::procedures
