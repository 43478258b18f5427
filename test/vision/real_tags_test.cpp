#include "support/real_tags.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <set>

#include <gtest/gtest.h>

#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::test {
namespace {

namespace fs = std::filesystem;
using estimation::Corners;
using namespace vision;

std::vector<TagDetection> detect(const cv::Mat& picture, double decimate, bool refine) {
  DetectorConfig config;
  config.quad_decimate = decimate;
  config.refine_edges = refine;
  return TagDetector(config).detect(picture);
}

TEST(RealTags, NoFewerIdsThanLibapriltagAndNoFalseOne) {
  const fs::path folder = photographs("swat_mapping");
  if (!fs::exists(folder)) GTEST_SKIP() << folder << " is absent";
  const auto truth = idsOf(folder / "groundtruth.txt");
  const auto pictures = picturesIn(folder);
  ASSERT_GE(pictures.size(), 12u);
  for (const double decimate : {1.0, 2.0}) {
    int found = 0, plain = 0, all = 0;
    for (const auto& [name, picture] : pictures) {
      ASSERT_TRUE(truth.count(name)) << name;
      std::multiset<int> ids;
      for (const TagDetection& tag : detect(picture, decimate, true)) {
        ids.insert(tag.id);
        EXPECT_TRUE(truth.at(name).count(tag.id)) << name << " holds no tag " << tag.id;
      }
      const std::multiset<int> by_itself = plainIds(picture, decimate);
      EXPECT_TRUE(std::includes(ids.begin(), ids.end(), by_itself.begin(), by_itself.end()))
          << name << " at decimate " << decimate;
      found += static_cast<int>(ids.size());
      plain += static_cast<int>(by_itself.size());
      all += static_cast<int>(truth.at(name).size());
    }
    EXPECT_GE(found, plain);
    EXPECT_GT(plain, all / 2);
    std::cout << "decimate " << decimate << ": " << found << " of " << all
              << " tags found, libapriltag by itself " << plain << "\n";
  }
}

TEST(RealTags, CornersAreThoseOfTheReference) {
  const fs::path folder = photographs("april_swarmathon");
  if (!fs::exists(folder)) GTEST_SKIP() << folder << " is absent";
  const auto pictures = picturesIn(folder);
  ASSERT_EQ(pictures.size(), 3u);
  for (const double decimate : {1.0, 2.0}) {
    // The reference was made at decimate 1, without refinement.
    for (const bool refine : {true, false}) {
      if (decimate > 1 && !refine) continue;
      double sum = 0;
      int found = 0, plain = 0, all = 0, foreign = 0;
      for (const auto& [name, picture] : pictures) {
        auto truth = cornersOf((folder / name).replace_extension(".txt"));
        all += static_cast<int>(truth.size());
        plain += static_cast<int>(plainIds(picture, decimate).size());
        for (const TagDetection& tag : detect(picture, decimate, refine)) {
          const auto near = std::find_if(truth.begin(), truth.end(), [&](const auto& entry) {
            return entry.first == tag.id &&
                   (entry.second - tag.corners).colwise().norm().maxCoeff() < 3;
          });
          if (near == truth.end()) {
            ++foreign;
            continue;
          }
          sum += (near->second - tag.corners).squaredNorm() / 8;
          truth.erase(near);
          ++found;
        }
      }
      ASSERT_GT(found, 0);
      EXPECT_GE(found, plain);
      const double rms = std::sqrt(sum / found);
      std::cout << "decimate " << decimate << (refine ? ", refined: " : ", not refined: ") << found
                << " of " << all << " tags, libapriltag by itself " << plain << ", " << foreign
                << " others, corners " << rms << " px RMS\n";
      EXPECT_EQ(foreign, 0);
      if (!refine) continue;
      EXPECT_LE(rms, 0.3);
    }
  }
}

}  // namespace
}  // namespace helix_arm::test
