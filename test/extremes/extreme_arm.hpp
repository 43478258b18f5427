#pragma once

#include <string>
#include <vector>

#include "support/paper_arm.hpp"
#include "support/random.hpp"

namespace helix_arm::test {

/// Whatever an arm may be built with.
struct Build {
  Ring ring;
  int sections = 1;
  double length = 0.43;  // of a muscle at rest [m]

  model::Arm arm() const {
    const model::Contraction muscle = fig3Muscle();
    return model::Arm(std::vector<model::Section>(
        sections, ringSection(ring, muscle.scaledBy(length / muscle.restLength()))));
  }
  std::string name() const {
    char out[200];
    std::snprintf(out, sizeof out,
                  "%d sections of %d, %.3g m long, radius %.3g m, tilt %.2g, K %.3g %.3g %.3g",
                  sections, ring.count, length, ring.radius, ring.tilt, ring.stiffness.gamma,
                  ring.stiffness.tau, ring.stiffness.kappa);
    return out;
  }
};

/// Arms that leave the ordinary in one respect.
struct BuildFamily {
  const char* range;
  std::vector<Build> builds;
};

inline std::vector<BuildFamily> extremeBuilds() {
  constexpr double kTilt = 15 * kPi / 180;
  const Build helical{helicalRing()}, straight{straightRing()};
  std::vector<BuildFamily> all;
  const auto family = [&all](const char* range) -> std::vector<Build>& {
    all.push_back({range, {}});
    return all.back().builds;
  };
  const auto vary = [&](std::vector<Build>& builds, const std::vector<double>& values,
                        auto&& change) {
    for (const Build& usual : {straight, helical}) {
      for (const double value : values) {
        builds.push_back(usual);
        change(builds.back(), value);
      }
    }
  };
  vary(family("diameters 1e-4 to 1 m"), {1e-4, 3e-4, 1e-3, 1e-2, 0.1, 1.0},
       [](Build& build, double diameter) { build.ring.radius = diameter / 2; });
  vary(family("diameters 1e-4 to 1 m, as soft to bend"), {1e-4, 3e-4, 1e-3, 1e-2, 0.1, 1.0},
       [](Build& build, double diameter) {
         build.ring.radius = diameter / 2;
         build.ring.stiffness.kappa = 1e-2 * diameter * diameter;
       });
  vary(family("K_kappa 0 and 1e-12 to 1e2"), {0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e2},
       [](Build& build, double kappa) { build.ring.stiffness.kappa = kappa; });
  vary(family("K_gamma 1 to 1e12"), {1.0, 10.0, 1e3, 1e6, 1e9, 1e12},
       [](Build& build, double gamma) { build.ring.stiffness.gamma = gamma; });
  vary(family("K_tau 0 and 1e-12 to 1e2"), {0.0, 1e-12, 1e-6, 1.0, 1e2},
       [](Build& build, double tau) { build.ring.stiffness.tau = tau; });
  vary(family("1 to 24 muscles"), {1, 2, 3, 4, 5, 6, 7, 8, 11, 16, 23, 24},
       [](Build& build, double count) {
         build.ring.count = static_cast<int>(count);
         build.ring.stiffness.tau = 1e-5;  // or one muscle spins about its own axis
       });
  vary(family("1 to 16 sections"), {1, 2, 3, 4, 6, 8, 12, 15, 16},
       [](Build& build, double sections) { build.sections = static_cast<int>(sections); });
  vary(family("lengths 1e-3 to 10 m"), {1e-3, 1e-2, 0.1, 1.0, 10.0},
       [](Build& build, double length) { build.length = length; });
  vary(family("lengths 1e-3 to 10 m, of one form"), {1e-3, 1e-2, 0.1, 1.0, 10.0},
       [](Build& build, double length) {
         const double scale = length / build.length;
         build.length = length;
         build.ring.radius *= scale;
         build.ring.stiffness.kappa *= scale * scale;
       });
  Random random(701);
  std::vector<Build>& any = family("all of it at once");
  for (int i = 0; i < 60; ++i) {
    Build build;
    build.ring.count = random.integer(3, 24);
    build.ring.radius = random.logUniform(5e-5, 0.5);
    build.ring.tilt = random.uniform(-kTilt, kTilt);
    build.ring.stiffness = {random.logUniform(1, 1e12),
                            random.integer(0, 1) * random.logUniform(1e-12, 1e2),
                            random.logUniform(1e-12, 1e2)};
    build.sections = random.integer(1, 16);
    build.length = random.logUniform(1e-3, 10);
    any.push_back(build);
  }
  return all;
}

}  // namespace helix_arm::test
