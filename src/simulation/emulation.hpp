#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "helix_arm/simulation/emulated_device.hpp"
#include "pseudo_terminal.hpp"

namespace helix_arm::simulation {

/// Valves, faults and clients of an emulated device, which all kinds have. What differs is how it
/// listens and what it makes of a request. Nothing waits; for one thread, or behind one lock.
class Emulation {
 public:
  /// How it speaks.
  struct Manner {
    double timeout;                                           ///< of its profile [s]
    std::string terminator;                                   ///< behind each answer
    double period = std::numeric_limits<double>::infinity();  ///< of unsolicited answers [s]
    std::uint32_t seed = 1;                                   ///< of the garbage
  };
  Emulation(int channels, const regulator::SimulatedRegulatorConfig& valves, Manner manner);
  virtual ~Emulation() = default;

  /// Does what is due. @return the longest wait until the next call, unless a file is ready [s].
  double work();
  std::vector<int> files() const;
  void setFault(DeviceFault fault);
  /// Lets the valves move until now.
  void catchUp();

  DeviceFault fault() const { return fault_; }
  std::uint64_t taken() const { return taken_; }
  std::uint64_t restarts() const { return restarts_; }
  double lastSetTime() const { return last_set_; }
  int connections() const { return static_cast<int>(clients_.size()); }
  const Eigen::VectorXd& pressure() const { return regulator_.pressure(); }

  virtual Eigen::VectorXd setPoint() const = 0;
  virtual std::vector<control::Valve> valves() const = 0;
  virtual std::string path() const { return {}; }
  virtual int port() const { return 0; }
  virtual void jam(int, bool) {}

 protected:
  struct Client {
    Stream stream;
    std::string input = {};  // the begin of a request
    bool is_there = true;    // false while nobody has opened a terminal
    std::deque<std::pair<double, std::string>> late = {};  // answers, and when they are due [s]
  };
  struct Outcome {
    bool taken = false, sets = false;
    std::optional<std::string> answer = std::nullopt;  // without terminator
  };

  /// Opens its line anew, to no client or the next one. @return false: only closed it, for now.
  /// @throws std::runtime_error if it cannot be opened.
  virtual bool open() = 0;
  /// File that new clients arrive at; below 0: its one client stays.
  virtual int listener() const { return -1; }
  virtual void accept() {}
  /// The last client has gone.
  virtual void loseLink() {}
  /// Takes the next whole request from what was received.
  virtual std::optional<std::string> next(std::string& input) const = 0;
  virtual Outcome take(const std::string& request) = 0;
  virtual std::optional<std::string> unasked() { return std::nullopt; }
  /// As after power-on.
  virtual void restart() = 0;
  virtual void step(double dt) { regulator_.step(dt); }

  /// (channels) under the fault, NaN where there is none [Pa].
  Eigen::VectorXd readings();

  const Manner manner_;
  regulator::SimulatedRegulator regulator_;
  std::vector<Client> clients_;
  DeviceFault fault_ = DeviceFault::kNone;
  double time_;  // of the valves, as regulator::steadyNow() [s]

 private:
  bool comesBack();
  void hear(std::size_t client);
  void say(Client& client, std::string answer);
  double sendLate();

  Eigen::VectorXd stuck_;  // readings of kStuckValue
  bool is_away_ = false;   // restarts
  double next_unasked_ = 0;
  std::uint64_t taken_ = 0, restarts_ = 0;
  double last_set_ = -std::numeric_limits<double>::infinity();
  std::mt19937 generator_;
};

/// Throw as EmulatedDevice.
std::unique_ptr<Emulation> emulate(const SerialDeviceConfig& config);
std::unique_ptr<Emulation> emulate(const ModbusDeviceConfig& config);

}  // namespace helix_arm::simulation
