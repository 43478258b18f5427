#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <set>
#include <sstream>

#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
#include <gtest/gtest.h>

#include "helix_arm/vision/frame_source.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::test {
namespace {

namespace fs = std::filesystem;
using estimation::Corners;
using vision::DetectorConfig;
using vision::Frame;
using vision::FrameSource;
using vision::FrameStatus;
using vision::TagDetection;
using vision::TagDetector;

// Photographs with licences of their own, which are not part of the project: where they are absent
// there is nothing to test.
fs::path photographs(const std::string& folder) {
  return fs::path(HELIX_ARM_SOURCE_DIR) / ".." / "shared" / "data" / "real_tags" / folder;
}

std::map<std::string, cv::Mat> picturesIn(const fs::path& folder) {
  std::map<std::string, cv::Mat> pictures;
  const auto source = FrameSource::files(folder.string());
  Frame frame;
  while (source->next(frame) != FrameStatus::kEnd) {
    EXPECT_EQ(frame.fault, "");
    pictures[fs::path(frame.name).filename().string()] = frame.gray.clone();
  }
  return pictures;
}

std::vector<TagDetection> detect(const cv::Mat& picture, double decimate, bool refine) {
  DetectorConfig config;
  config.quad_decimate = decimate;
  config.refine_edges = refine;
  return TagDetector(config).detect(picture);
}

// Ids that libapriltag finds by itself, with its own defaults.
std::multiset<int> plainIds(const cv::Mat& picture, double decimate) {
  apriltag_family_t* family = tag36h11_create();
  apriltag_detector_t* detector = apriltag_detector_create();
  apriltag_detector_add_family(detector, family);
  detector->quad_decimate = static_cast<float>(decimate);
  image_u8_t image{picture.cols, picture.rows, static_cast<int>(picture.step[0]), picture.data};
  zarray_t* found = apriltag_detector_detect(detector, &image);
  std::multiset<int> ids;
  for (int i = 0; i < zarray_size(found); ++i) {
    apriltag_detection_t* tag = nullptr;
    zarray_get(found, i, &tag);
    ids.insert(tag->id);
  }
  apriltag_detections_destroy(found);
  apriltag_detector_destroy(detector);
  tag36h11_destroy(family);
  return ids;
}

// groundtruth.txt: a picture, then the ids in it.
std::map<std::string, std::multiset<int>> idsOf(const fs::path& path) {
  std::map<std::string, std::multiset<int>> ids;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    std::string name;
    words >> name;
    for (int id; words >> id;) ids[name].insert(id);
  }
  return ids;
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

// `id, (x y), (x y), (x y), (x y)` a line: what libapriltag said, whose pixels have their centres
// at halves.
std::vector<std::pair<int, Corners>> cornersOf(const fs::path& path) {
  std::vector<std::pair<int, Corners>> tags;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    for (char& c : line) {
      if (c == ',' || c == '(' || c == ')') c = ' ';
    }
    std::istringstream words(line);
    int id = 0;
    Corners corners;
    if (!(words >> id)) continue;
    for (int k = 0; k < 4; ++k) words >> corners(0, k) >> corners(1, k);
    EXPECT_TRUE(words) << path << ": " << line;
    tags.emplace_back(id, corners.array() - 0.5);
  }
  return tags;
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
