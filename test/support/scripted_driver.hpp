#pragma once

#include <atomic>
#include <mutex>
#include <thread>

#include "helix_arm/regulator/driver.hpp"

namespace helix_arm::test {

/// What a regulator does, in the hands of a test; shared with the driver that speaks to it.
class ScriptedDevice {
 public:
  explicit ScriptedDevice(int channels)
      : taken_(channels), reading_(Eigen::VectorXd::Zero(channels)) {}

  std::atomic<bool> refuses{false};    ///< to be connected to
  std::atomic<bool> mute{false};       ///< the link is down
  std::atomic<int> bad_replies{0};     ///< so many answers are garbage
  std::atomic<bool> keeps_air{false};  ///< once its link is closed
  std::atomic<bool> hangs{false};      ///< an exchange does not come back until it is false
  std::atomic<double> watchdog{std::numeric_limits<double>::infinity()};  ///< of its line [s]
  std::atomic<int> attempts{0}, connections{0}, vents{0}, closings{0}, writes{0};

  control::ValveOrders taken() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return taken_;
  }
  void set(const control::ValveOrders& orders) {
    const std::lock_guard<std::mutex> lock(mutex_);
    taken_ = orders;
  }
  Eigen::VectorXd reading() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return reading_;
  }
  void read(const Eigen::VectorXd& reading) {
    const std::lock_guard<std::mutex> lock(mutex_);
    reading_ = reading;
  }

 private:
  mutable std::mutex mutex_;
  control::ValveOrders taken_;
  Eigen::VectorXd reading_;
};

class ScriptedDriver : public regulator::Driver {
 public:
  explicit ScriptedDriver(ScriptedDevice& device) : device_(device) {}

  void connect() override {
    ++device_.attempts;
    if (device_.refuses || device_.mute) throw regulator::LinkError("refused");
    device_.set(control::ValveOrders(static_cast<int>(device_.reading().size())));
    ++device_.connections;
  }
  void write(const control::ValveOrders& orders) override {
    exchange();
    device_.set(orders);
    ++device_.writes;
  }
  void read(regulator::Pressures& pressures) override {
    exchange();
    pressures.pressure = device_.reading();
  }
  void vent() override {
    exchange();
    device_.set(control::ValveOrders(static_cast<int>(device_.reading().size())));
    ++device_.vents;
  }
  bool keepsAirOnClose() const noexcept override { return device_.keeps_air; }
  double watchdog() const noexcept override { return device_.watchdog; }
  void close() noexcept override { ++device_.closings; }

 private:
  void exchange() {
    while (device_.hangs) std::this_thread::yield();
    if (device_.mute) throw regulator::LinkError("no answer");
    if (device_.bad_replies > 0) {
      --device_.bad_replies;
      throw regulator::BadReply("garbage");
    }
  }

  ScriptedDevice& device_;
};

}  // namespace helix_arm::test
