#include "helix_arm/procedures/new_scene.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <variant>
#include <vector>

#include "helix_arm/basics/pi.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/io/number.hpp"
#include "helix_arm/io/regulator_profile.hpp"
#include "helix_arm/localization/tag_layout.hpp"

namespace helix_arm::procedures {
namespace {

using io::formatNumber;

constexpr double kMuscleRadius = 0.008;  // [m]
constexpr double kRim = 0.012;           // of a separator, beyond the muscles' centre lines [m]
constexpr double kStandOff = 0.016;      // of a tag, likewise [m]
constexpr double kWithBorder = 1.25;     // a tag with the white that the detector needs
constexpr double kFirstTag = 0.04;       // its s
constexpr double kTagBits = 8;           // across the black border of 36h11
constexpr double kSmallBit = 3.5;        // of a tag that faces the camera [px]
constexpr int kMostTags = 7;             // per muscle, unless asked for
constexpr double kFocal = 930, kWidth = 1280, kHeight = 720;  // of a usual webcam [px]
constexpr double kCameraDistance = 1.75;                      // in lengths of the arm
constexpr double kReadableBit = 2.2;   // of a tag proposed, facing the camera [px]
constexpr double kCameraAzimuth = 35;  // about the world's z, between two muscles [deg]

constexpr char kBoard[] = "generic";  // the profile of docs/board.md
constexpr char kCommand[] = "helix_arm new";

void requireWithin(const char* what, double value, double least, double most, const char* rule) {
  basics::requireValue(std::isfinite(value) && value >= least && value <= most, kCommand, what,
                       value, rule);
}

double roundedTo(double value, double step) { return step * std::round(value / step); }

// Of a muscle at its highest pressure [m].
double shortest(const NewScene& scene) { return scene.length * (1 - scene.contraction); }

// Rounded to the digits that a builder can measure.
std::string number(double value) { return formatNumber(roundedTo(value * 1e6, 1) / 1e6); }

double cameraDistance(const NewScene& scene) {
  if (scene.camera_distance > 0) return scene.camera_distance;
  return std::max(0.35, roundedTo(kCameraDistance * scene.sections * scene.length, 0.05));
}

// s from the first tag of a section to its last. Half a tag stays free where another section
// follows.
struct TagSpan {
  double first, last;
};
TagSpan tagSpan(const NewScene& scene, bool end_of_arm) {
  const double half = 0.5 * kWithBorder * scene.tag_size / shortest(scene);
  const double margin = std::max(kFirstTag, scene.sections > 1 ? 1.1 * half : 0.0);
  return {margin, end_of_arm ? 1 : 1 - margin};
}

std::vector<std::string> tagPositions(const NewScene& scene, int section, int count) {
  const TagSpan span = tagSpan(scene, section + 1 == scene.sections);
  std::vector<std::string> out;
  for (int k = 0; k < count; ++k) {
    const double s = span.first + (span.last - span.first) * k / (count - 1);
    out.push_back(number(roundedTo(s, 1e-3)));
  }
  return out;
}

// Length along which the tags of a section fit [m].
double roomForTags(const NewScene& scene) {
  const TagSpan span = tagSpan(scene, scene.sections == 1);
  return (span.last - span.first) * shortest(scene);
}

std::string listText(const std::vector<std::string>& words) {
  return "[" + basics::joined(words) + "]";
}

std::string sectionName(const NewScene& scene, int section) {
  return scene.sections == 1 ? "arm" : "section_" + std::to_string(section + 1);
}

void writeArm(const NewScene& scene, std::ostream& out) {
  // The usual curve of an artificial muscle: steepest in the middle.
  const double shares[] = {0, 0.25, 0.7, 1};
  std::vector<std::string> pressures, lengths;
  for (int k = 0; k < 4; ++k) {
    pressures.push_back(number(roundedTo(scene.max_pressure_kpa * k / 3, 0.1)));
    lengths.push_back(number(scene.length * (1 - scene.contraction * shares[k])));
  }
  pressures.back() = formatNumber(scene.max_pressure_kpa);
  const double height = roundedTo(scene.sections * scene.length + 0.3, 0.05);
  out << "\ncontractions:\n"
         "  # Free length of one muscle, without load, at several pressures. These values are a "
         "guess: measure\n"
         "  # yours with a ruler at four pressures or more. A calibration can only scale them.\n"
         "  muscle:\n"
         "    table:\n"
      << "      pressure_kpa: " << listText(pressures) << "\n"
      << "      length_m: " << listText(lengths) << "\n"
      << "\narm:\n"
         "  geometry: spatial\n"
      << "  # The base is " << number(height)
      << " m above the origin and faces down: x of the arm is -z of the world.\n"
      << "  base: {position_m: [0, 0, " << number(height) << "], rpy_deg: [0, 90, 0]}\n"
      << "  # Values of another arm of such muscles; a calibration finds those of yours.\n"
         "  stiffness: {K_gamma: "
      << (scene.tilt_deg == 0 ? 10 : 100)
      << ", K_tau_m2: 0, K_kappa_m2: 1.38e-4}\n"
         "  sections:\n";
  for (int section = 0; section < scene.sections; ++section) {
    out << "    - name: " << sectionName(scene, section) << "\n"
        << "      # The first muscle lies on the y axis, the others follow from y towards z.\n"
        << "      ring:\n"
        << "        count: " << scene.muscles << "\n"
        << "        radius_m: " << formatNumber(scene.radius)
        << "  # from the centre line of the arm to that of a muscle\n";
    if (scene.tilt_deg != 0) {
      out << "        tilt_deg: " << formatNumber(scene.tilt_deg)
          << "  # of the muscles, wound around the arm\n";
    }
    out << "        contraction: muscle\n"
        << "        max_pressure_kpa: " << formatNumber(scene.max_pressure_kpa) << "\n"
        << "      separators: " << std::max(3, static_cast<int>(std::lround(scene.length / 0.03)))
        << "\n"
        << "      separator_radius_m: " << number(scene.radius + kRim) << "\n"
        << "      muscle_radius_m: " << formatNumber(kMuscleRadius) << "\n";
  }
}

void writeVision(const NewScene& scene, std::ostream& out) {
  const int count = scene.tagsPerMuscle();
  out << "\n# " << scene.sections * scene.muscles * count
      << " printed tags: helix_arm tags prints them and a sheet that shows where each is mounted.\n"
         "tags:\n"
         "  family: 36h11\n"
      << "  size_m: " << formatNumber(scene.tag_size)
      << "  # outer edge of the black border, measured on the print\n"
      << "  placement_prior: {translation_m: 0.003, rotation_deg: 3}\n"
         "  groups:\n";
  int id = 0;
  for (int muscle = 0; muscle < scene.sections * scene.muscles; ++muscle) {
    std::vector<std::string> ids;
    for (int k = 0; k < count; ++k) ids.push_back(std::to_string(id++));
    out << "    - section: " << sectionName(scene, muscle / scene.muscles) << "\n"
        << "      actuator: muscle_" << muscle + 1 << "\n"
        << "      ids: " << listText(ids) << "\n"
        << "      s: " << listText(tagPositions(scene, muscle / scene.muscles, count)) << "\n"
        << "      position_m: [0, 0, " << formatNumber(kStandOff)
        << "]  # z: distance of the paper from the muscle's centre line\n";
  }
  const double length = scene.sections * scene.length;
  const double distance = cameraDistance(scene);
  const double azimuth = kCameraAzimuth * basics::kPi / 180;
  const double height = roundedTo(length + 0.3, 0.05) - length / 2;
  out << "\n# A webcam, " << number(distance)
      << " m beside the arm at half its height. The lens is a guess, to be replaced by\n"
         "#   helix_arm camera calibrate --source webcam --scene THIS --out THIS\n"
         "# and the pose by helix_arm camera place THIS --source webcam --out THIS\n"
         "camera:\n"
      << "  size_px: [" << kWidth << ", " << kHeight << "]\n"
      << "  focal_px: [" << kFocal << ", " << kFocal << "]\n"
      << "  centre_px: [" << (kWidth - 1) / 2 << ", " << (kHeight - 1) / 2 << "]\n"
      << "  position_m: [" << number(distance * std::cos(azimuth)) << ", "
      << number(distance * std::sin(azimuth)) << ", " << number(height) << "]\n"
      << "  rpy_deg: [0, 0, " << formatNumber(kCameraAzimuth - 180) << "]\n"
      << "  webcam: {device: /dev/video0}\n"
         "\nvision:\n"
         "  # The base is known as well as a tape measure tells, and white bleeds into black.\n"
         "  base_prior: {translation_m: 0.002, rotation_deg: 0.5}\n"
         "  bleed_prior_m: 0.0005\n";
  if (kFocal * scene.tag_size / kTagBits / distance < kSmallBit) {
    out << "  quad_decimate: 1  # small tags in the picture: the whole picture is searched, which "
           "is "
           "slower\n";
  }
}

// Of a channel. Alicat's devices have letters; others count.
std::string addressOf(const NewScene& scene, int channel) {
  return scene.regulator == "alicat" ? std::string(1, static_cast<char>('A' + channel))
                                     : std::to_string(channel);
}

// What the device takes, as its profile says.
template <class Profile>
void requireDevice(const NewScene& scene, const Profile& profile) {
  const double highest = io::kilopascals(profile.highestPressure());
  const std::string culprit = std::string(kCommand) + ": --regulator " + scene.regulator;
  basics::require(scene.max_pressure_kpa <= highest, culprit, " takes ", formatNumber(highest),
                  " kPa at most, and --max-pressure-kpa is ", formatNumber(scene.max_pressure_kpa),
                  "; choose a lower pressure or another regulator. If your device gives more, "
                  "name a copy of its profile that says so (highest_kpa, highest_count)");
  const int channels = scene.sections * scene.muscles;
  basics::require(channels <= profile.channels.value_or(channels), culprit, " has ",
                  profile.channels.value_or(0), " channels at most, and --sections ",
                  scene.sections, " with --muscles ", scene.muscles, " need ", channels,
                  "; choose fewer muscles or another regulator. If your device has more, name a "
                  "copy of its profile that says so (channels)");
}

void writeProfile(const NewScene& scene, std::ostream& out) {
  const io::RegulatorProfile profile = io::loadRegulatorProfile(scene.regulator);
  const auto* serial = std::get_if<regulator::SerialProfile>(&profile);
  out << (serial != nullptr ? "  ascii_serial:\n" : "  modbus_tcp:\n")
      << "    profile: " << io::yamlText(scene.regulator)
      << (scene.regulator == kBoard ? "  # the board of docs/board.md: 300 kPa at most\n" : "\n");
  if (serial == nullptr) {
    out << "    host: " << io::yamlText(scene.host) << "\n";
    return;
  }
  out << "    device: " << io::yamlText(scene.device) << "\n";
  if (serial->write.find("{address}") == std::string::npos) return;
  std::vector<std::string> addresses;
  for (int k = 0; k < scene.sections * scene.muscles; ++k) {
    addresses.push_back("\"" + addressOf(scene, k) + "\"");
  }
  out << "    addresses: " << listText(addresses) << "  # channels, in the order of the muscles\n";
}

void writeRegulator(const NewScene& scene, std::ostream& out) {
  if (scene.regulator == "none") {
    out << "\n# No regulator: shapes are computed and measured, nothing is commanded. See "
           "docs/safety.md.\n";
    return;
  }
  out << "\n# See docs/safety.md for other devices, and before you connect a supply.\nregulator:\n";
  if (scene.isHardware()) {
    writeProfile(scene, out);
  } else {
    out << "  simulated: {time_constant_s: 0.15, supply_kpa: "
        << formatNumber(std::ceil(scene.max_pressure_kpa * 1.2)) << ", noise_kpa: 2}\n";
  }
  out << "\n# When the arm vents by itself. config/scenes/annotated.yaml explains every key.\n";
  if (scene.regulator == kBoard) {
    out << "# The faults in docs/board.md were tried with these values.\n"
           "safety:\n"
           "  target_timeout_s: 0.5\n"
           "  reading_timeout_s: 0.4\n"
           "  slew_kpa_s: 300\n"
           "  follow: {tolerance_kpa: 30, time_s: 0.4, time_constant_s: 0.1}\n";
    return;
  }
  out << "safety:\n"
         "  target_timeout_s: 1\n"
         "  slew_kpa_s: 300\n"
         "  follow: {tolerance_kpa: 40, time_s: 1, time_constant_s: 0.15}\n";
}

}  // namespace

int NewScene::tagsPerMuscle() const {
  if (tag_size <= 0) return 0;
  const int fit = 1 + static_cast<int>(std::floor(roomForTags(*this) / (kWithBorder * tag_size)));
  return tags > 0 ? tags : std::min({fit, kMostTags, estimation::kMaxTags / (sections * muscles)});
}

double NewScene::fittingTagSize() const {
  NewScene smaller = *this;
  const double readable = kReadableBit * kTagBits * cameraDistance(*this) / kFocal;
  smaller.tag_size = std::clamp(std::ceil(1e3 * readable) / 1e3, tag_size, kMostTagSize);
  while (smaller.tag_size > 0) {
    try {
      smaller.validate();
      return smaller.tag_size;
    } catch (const std::invalid_argument&) {
      const double next = (std::ceil(1e3 * smaller.tag_size - 1e-6) - 1) / 1e3;
      smaller.tag_size = next >= kLeastTagSize ? next : 0;
    }
  }
  return 0;
}

void NewScene::validateRanges() const {
  requireWithin("--sections", sections, 1, 16, "1 to 16");
  requireWithin("--muscles", muscles, 3, 24, "3 to 24 per section; write other arms by hand");
  requireWithin("--length-m", length, 0.02, 5, "0.02 to 5 m");
  requireWithin("--contraction", contraction, 0.01, 0.5, "0.01 to 0.5 of the length");
  requireWithin("--radius-m", radius, 0.002, 1, "0.002 to 1 m");
  requireWithin("--tilt-deg", tilt_deg, -60, 60, "-60 to 60 degrees");
  requireWithin("--max-pressure-kpa", max_pressure_kpa, 1, 2000, "1 to 2000 kPa");
  basics::requireValue(camera_distance == 0 || (camera_distance >= 0.1 && camera_distance <= 10),
                       kCommand, "--camera-distance-m", camera_distance,
                       "0.1 to 10 m, or 0 so that the arm fits the picture");
  if (tag_size == 0) return;
  requireWithin("--tag-size-m", tag_size, kLeastTagSize, kMostTagSize,
                "0.005 to 0.3 m, or 0 for no tags");
  basics::requireValue(tags == 0 || (tags >= 2 && tags <= 20), kCommand, "--tags", tags,
                       "2 to 20 per muscle, or 0 for as many as fit");
}

void NewScene::validate() const {
  validateRanges();
  if (tag_size == 0) return;
  const int actuators = sections * muscles;
  basics::require(2 * actuators <= estimation::kMaxTags, kCommand, ": ", actuators,
                  " muscles with two tags each have more tags than a scene may have, ",
                  estimation::kMaxTags,
                  "; choose --tag-size-m 0, and write the tags of some muscles by hand");
  const int count = tagsPerMuscle();
  basics::require(actuators * count <= estimation::kMaxTags, kCommand, ": --tags is ", tags,
                  ", which makes ", actuators * count, " tags; expected at most ",
                  estimation::kMaxTags, " in all, so ", estimation::kMaxTags / actuators,
                  " per muscle");
  basics::require(count >= 2 && (count - 1) * kWithBorder * tag_size <= roomForTags(*this) + 1e-9,
                  kCommand, ": ", std::max(count, 2), " tags of ", formatNumber(1e3 * tag_size),
                  " mm with their white border do not fit on a muscle of ",
                  formatNumber(1e3 * length),
                  " mm; choose smaller (--tag-size-m) or fewer (--tags)");
  const double side = 2 * (radius + kStandOff) * std::tan(basics::kPi / muscles);
  basics::require(kWithBorder * tag_size <= side, kCommand, ": --tag-size-m is ",
                  formatNumber(tag_size), ", which overlaps on ", muscles,
                  " muscles side by side; expected at most ",
                  formatNumber(1e-3 * std::floor(1e3 * side / kWithBorder)));
}

void NewScene::validateRegulator() const {
  if (!isHardware()) return;
  std::visit([this](const auto& profile) { requireDevice(*this, profile); },
             io::loadRegulatorProfile(regulator));
}

std::string newSceneText(const NewScene& scene) {
  scene.validate();
  scene.validateRegulator();
  std::ostringstream out;
  out << "# Written by helix_arm new. Every key is explained in config/scenes/annotated.yaml.\n"
         "# Next: helix_arm check THIS, helix_arm tags THIS --out tags.pdf; docs/first_arm.md\n"
      << "name: " << scene.name << "\n";
  writeArm(scene, out);
  if (scene.tag_size > 0) writeVision(scene, out);
  out << "\n# How the simulated rig differs from this file: a calibration has something to find.\n"
         "simulation:\n"
         "  arm: {K_kappa_scale: 1.2, length_scale: 1.01}\n"
         "  camera: {blur_px: 0.7, noise_gray_levels: 2, jpeg_quality: 85}\n";
  writeRegulator(scene, out);
  return out.str();
}

}  // namespace helix_arm::procedures
