#include "helix_arm/simulation/mount_deviation.hpp"

#include <cmath>
#include <random>

#include "helix_arm/basics/number_requirement.hpp"

namespace helix_arm::simulation {
namespace {

const char* const kTrueMounts = "true mounts";

// Separate streams of one seed, so that the camera's noise does not affect the tags'.
enum Stream : std::uint32_t { kCameraStream, kTagStream };

class Noise {
 public:
  Noise(std::uint32_t seed, Stream stream) {
    std::seed_seq sequence{seed, static_cast<std::uint32_t>(stream)};
    generator_.seed(sequence);
  }
  lie::Vector6 draw(double translation, double rotation) {
    lie::Vector6 out;
    for (int i = 0; i < 6; ++i) out[i] = (i < 3 ? translation : rotation) * normal_(generator_);
    return out;
  }

 private:
  std::mt19937_64 generator_;
  std::normal_distribution<double> normal_;
};

}  // namespace

void MountDeviation::validate() const {
  const auto check = [](const char* what, double value) {
    basics::requireNotNegative(kTrueMounts, what, value);
  };
  check("the deviation of the camera's place [m]", camera_translation);
  check("the deviation of the camera's direction [rad]", camera_rotation);
  check("the deviation of the tags' places [m]", tag_translation);
  check("the deviation of the tags' directions [rad]", tag_rotation);
}

estimation::TagLayout deviate(const estimation::TagLayout& layout, const model::Arm& arm,
                              const MountDeviation& deviation) {
  deviation.validate();
  layout.validate(arm.sectionCount());
  Noise noise(deviation.seed, kTagStream);
  const int base_tag = layout.baseTag();
  estimation::TagLayout out = layout;
  for (int i = 0; i < static_cast<int>(out.tags.size()); ++i) {
    const lie::Vector6 moved = noise.draw(deviation.tag_translation, deviation.tag_rotation);
    if (i == base_tag) continue;
    const double rest_length = arm.restLength(out.tags[i].section);
    out.tags[i] = estimation::movedBy(out.tags[i], moved, rest_length);
  }
  return out;
}

estimation::ArmView deviate(const estimation::ArmView& view, const model::Arm& arm,
                            const MountDeviation& deviation) {
  estimation::ArmView out = view;
  out.layout = deviate(view.layout, arm, deviation);
  Noise noise(deviation.seed, kCameraStream);
  out.X_CB = view.X_CB *
             lie::SE3::exp(noise.draw(deviation.camera_translation, deviation.camera_rotation));
  return out;
}

}  // namespace helix_arm::simulation
