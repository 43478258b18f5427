#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "helix_arm/control/safety.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/guard_process.hpp"
#include "helix_arm/simulation/emulated_device.hpp"
#include "latency_histogram.hpp"
#include "support/random.hpp"

namespace helix_arm::test {

/// An emulated device, of whichever line.
struct SoakedDevice {
  std::string name;
  std::shared_ptr<void> device;  ///< keeps it
  std::function<void(simulation::DeviceFault)> setFault;
  std::function<Eigen::VectorXd()> pressure;  ///< true, gauge [Pa]
  std::function<double()> last_write;         ///< of set points, of steadyNow() [s]
};

/// What is done to the arm: the faults of its device, by their number, and three more.
inline constexpr int kSilentCommander = simulation::kDeviceFaultCount;
inline constexpr int kStopEngaged = kSilentCommander + 1;
inline constexpr int kVentAsked = kStopEngaged + 1;
inline constexpr int kTroubleCount = kVentAsked + 1;
const char* troubleName(int trouble);

/// How the arm took one kind of trouble.
struct TroubleTally {
  int injected = 0;
  int endured = 0;  ///< without leaving kEnabled, where it was shorter than its rule, or harmless
  /// That had to end kEnabled and did not, after which pressure still stood, or in which it was
  /// astray.
  int missed = 0;
  LatencyHistogram decided;  ///< from the trouble to the end of kEnabled
  LatencyHistogram empty;    ///< from the trouble to no pressure in any channel
};

struct SoakTally {
  std::array<TroubleTally, kTroubleCount> troubles;
  LatencyHistogram writes;    ///< from a target to the device's taking it
  std::uint64_t targets = 0;  ///< that were taken
  int missed = 0;             ///< of all troubles, and without one
  int unprovoked = 0;         ///< faults without a trouble
  int stranded = 0;           ///< troubles after which it could not be enabled again
  double highest = 0;         ///< true pressure of any channel, of its limit
  bool burst = false;         ///< it went beyond the limit by more than the margin of the rules
  std::string last_reason;    ///< of the last miss
};

/// Commands one arm at 1 kHz, makes trouble at random, and looks at the device's true pressures.
class SoakedArm {
 public:
  /// @param scene  whose regulator is the device.
  SoakedArm(const io::Scene& scene, SoakedDevice device, unsigned seed);

  /// Until told to stop, or the arm is stranded.
  void run(const std::atomic<bool>& stop);
  const SoakTally& tally() const { return tally_; }

 private:
  enum class Phase { kFollow, kTrouble, kRecover };

  void turn();
  void follow();
  void begin(int trouble);
  void endure();
  void recover();
  void enter(Phase phase, double lasts);
  bool enabled() const { return path_.core().state() == control::SafetyState::kEnabled; }
  bool empty() const;
  double mustDecide() const;
  void note();
  void watchCourse();
  void miss(const std::string& what);

  SoakedDevice device_;
  Random random_;
  regulator::PressurePath path_;
  const control::SafetyRules rules_;
  SoakTally tally_;

  double now_ = 0;
  Eigen::VectorXd goal_;
  Eigen::VectorXd true_pressure_;
  std::vector<control::Persistence> astray_;  // (channels) while enabled
  double next_goal_ = 0;
  double pending_target_ = 0;  ///< whose write is waited for; 0: none

  Phase phase_ = Phase::kRecover;
  double phase_began_ = 0, phase_ends_ = 0;
  int trouble_ = -1;
  double trouble_began_ = 0, trouble_ended_ = 0;
  bool decided_ = false, emptied_ = false, missed_ = false;
  double left_enabled_ = 0;
};

}  // namespace helix_arm::test
