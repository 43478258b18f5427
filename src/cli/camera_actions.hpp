#pragma once

#include <optional>
#include <string>
#include <vector>

#include "board_arguments.hpp"
#include "camera_source.hpp"
#include "command.hpp"
#include "helix_arm/io/scene.hpp"
#include "nlohmann/json.hpp"

// What `helix_arm camera` can do.

namespace helix_arm::cli {

struct CameraArguments {
  std::string scene;  ///< calibrate: empty for none
  std::vector<std::string> sources;
  std::string out;           ///< empty: nothing is written
  BoardArguments board;      ///< calibrate
  std::string device, size;  ///< calibrate: of a webcam without scene
  std::optional<int> focus;  ///< calibrate: likewise
  int coefficients = 5;      ///< calibrate
  int views = 25;            ///< calibrate: of a webcam or a video
  std::optional<double> seconds;
  std::string pressure_kpa, input;  ///< place
};

int calibrateCameraOf(const CameraArguments& arguments, const GlobalOptions& global);
int placeCameraOf(const CameraArguments& arguments, const GlobalOptions& global);

/// Faults of pictures as text on stderr.
void tellFaults(const PicturesRead& read);
nlohmann::json faultsJson(const PicturesRead& read);

}  // namespace helix_arm::cli
