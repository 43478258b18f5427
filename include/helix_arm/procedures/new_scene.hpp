#pragma once

#include <string>

namespace helix_arm::procedures {

/// Of a tag of a new scene [m].
inline constexpr double kLeastTagSize = 0.005, kMostTagSize = 0.3;

/// An arm as its builder describes it: equal sections in series, each a ring of equal muscles that
/// shorten. It hangs, and a webcam looks at it from the side.
struct NewScene {
  std::string name = "my_arm";    ///< a word of letters, digits, _ and -
  int sections = 1;               ///< 1 to 16
  int muscles = 3;                ///< per section, 3 to 24
  double length = 0.3;            ///< of a muscle at 0 kPa, 0.02 to 5 [m]
  double contraction = 0.2;       ///< by how much it shortens at max_pressure, 0.01 to 0.5
  double radius = 0.025;          ///< from the centre line to the muscles', 0.002 to 1 [m]
  double tilt_deg = 0;            ///< of the muscles around the arm, -60 to 60
  double max_pressure_kpa = 300;  ///< gauge, 1 to 2000
  double tag_size = 0.03;         ///< outer edge of the black border, 0.005 to 0.3 [m]; 0: no tags
  int tags = 0;                ///< per muscle, 2 to 20; 0: as many as fit, at most 7, and 64 in all
  double camera_distance = 0;  ///< from the arm, 0.1 to 10 [m]; 0: so that the arm fits
  /// "simulated", "none", or a profile as io::loadRegulatorProfile() takes it, its path absolute.
  std::string regulator = "simulated";
  std::string device = "/dev/serial/by-id/usb-YOUR_BOARD";  ///< of a profile of a serial line
  std::string host = "192.168.1.10";                        ///< of a profile of Modbus TCP

  bool isHardware() const { return regulator != "simulated" && regulator != "none"; }
  /// The rules of each value by itself.
  /// @throws std::invalid_argument naming the option of `helix_arm new`, its value, its rule and
  /// the remedy.
  void validateRanges() const;
  /// Also that the tags fit. @throws likewise.
  void validate() const;
  /// That the device takes the pressures and has the channels, as its profile says. @throws
  /// likewise.
  void validateRegulator() const;
  /// Tags per muscle.
  int tagsPerMuscle() const;
  /// tag_size, or what the camera needs where that is larger; or what fits on the arm where that is
  /// smaller than both: whole millimetres; 0 if no tags do.
  double fittingTagSize() const;
};

/// A commented scene file. It loads without faults.
/// @throws std::invalid_argument as validate(), or as io::loadRegulatorProfile().
std::string newSceneText(const NewScene& scene);

}  // namespace helix_arm::procedures
