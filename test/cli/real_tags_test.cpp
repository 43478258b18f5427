// Photographs of real tags through the command.
#include "support/real_tags.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>

#include <gtest/gtest.h>

#include "command.hpp"

namespace helix_arm::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// What the command finds in a folder of photographs, with a scene that has no tags of its own.
json localized(const fs::path& folder, double decimate) {
  const Outcome outcome =
      runCommand({"localize", scenePath("planar_50"), folder.string(), "--format", "json", "--set",
                  "vision.quad_decimate=" + std::to_string(decimate)});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  return outcome.json()["frames"];
}

std::string nameOf(const json& frame) {
  return fs::path(frame["file"].get<std::string>()).filename().string();
}

estimation::Corners cornersIn(const json& tag) {
  estimation::Corners corners;
  for (int k = 0; k < 4; ++k) {
    for (int axis = 0; axis < 2; ++axis) corners(axis, k) = tag["corners_px"][k][axis];
  }
  return corners;
}

TEST(LocalizePhotographs, NoFewerIdsThanLibapriltagAndNoFalseOne) {
  const fs::path folder = photographs("swat_mapping");
  if (!fs::exists(folder)) GTEST_SKIP() << folder << " is absent";
  const auto truth = idsOf(folder / "groundtruth.txt");
  const auto pictures = picturesIn(folder);
  for (const double decimate : {1.0, 2.0}) {
    const json frames = localized(folder, decimate);
    ASSERT_EQ(frames.size(), pictures.size());
    std::size_t found = 0, plain = 0;
    for (const json& frame : frames) {
      const std::string name = nameOf(frame);
      ASSERT_TRUE(truth.count(name) > 0 && pictures.count(name) > 0) << name;
      for (const json& tag : frame["tags"]) {
        EXPECT_TRUE(truth.at(name).count(tag["id"])) << name << " holds no tag " << tag["id"];
      }
      found += frame["tags"].size();
      plain += plainIds(pictures.at(name), decimate).size();
    }
    std::cout << "decimate " << decimate << ": " << found << " tags, libapriltag by itself "
              << plain << "\n";
    EXPECT_GT(plain, 0u);
    EXPECT_GE(found, plain);
  }
}

TEST(LocalizePhotographs, CornersAreThoseOfTheReference) {
  const fs::path folder = photographs("april_swarmathon");
  if (!fs::exists(folder)) GTEST_SKIP() << folder << " is absent";
  const auto pictures = picturesIn(folder);
  for (const double decimate : {1.0, 2.0}) {
    double square = 0;
    std::size_t found = 0, plain = 0;
    for (const json& frame : localized(folder, decimate)) {
      const std::string name = nameOf(frame);
      auto truth = cornersOf((folder / name).replace_extension(".txt"));
      plain += plainIds(pictures.at(name), decimate).size();
      for (const json& tag : frame["tags"]) {
        const estimation::Corners corners = cornersIn(tag);
        const auto near = std::find_if(truth.begin(), truth.end(), [&](const auto& entry) {
          return entry.first == tag["id"] &&
                 (entry.second - corners).colwise().norm().maxCoeff() < 3;
        });
        ASSERT_NE(near, truth.end()) << name << " holds no such tag: " << tag;
        square += (near->second - corners).squaredNorm() / 8;
        truth.erase(near);
        ++found;
      }
    }
    const double rms = std::sqrt(square / static_cast<double>(found));
    std::cout << "decimate " << decimate << ": " << found << " tags, libapriltag by itself "
              << plain << ", corners " << rms << " px RMS\n";
    EXPECT_GT(plain, 0u);
    EXPECT_GE(found, plain);
    EXPECT_LE(rms, 0.3);
  }
}

}  // namespace
}  // namespace helix_arm::test
