#pragma once

#include <string>
#include <vector>

namespace helix_arm::test {

/// Two machines and the switch between them, as network namespaces of this one.
class TwoNetworks {
 public:
  /// @throws std::runtime_error when this process may not make them, with what was refused.
  TwoNetworks();
  ~TwoNetworks();
  TwoNetworks(const TwoNetworks&) = delete;
  TwoNetworks& operator=(const TwoNetworks&) = delete;

  /// Moves this thread, and all that it starts from now on, to the control machine.
  void enterControl() const;
  /// A command that runs on the camera machine.
  std::vector<std::string> onCamera(const std::vector<std::string>& command) const;

  /// Pulls the camera machine's cable, and puts it back.
  void cut() const;
  void heal() const;

  static constexpr char kControl[] = "10.77.0.1";
  static constexpr char kCamera[] = "10.77.0.2";

 private:
  std::string name(const std::string& machine) const;
  void remove() const;
};

}  // namespace helix_arm::test
