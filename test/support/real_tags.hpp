#pragma once

#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <utility>

#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/vision/frame_source.hpp"
#include "helix_arm/vision/tag_detector.hpp"

namespace helix_arm::test {

/// Photographs with licences of their own, which are not part of the project: where they are absent
/// there is nothing to test.
inline std::filesystem::path photographs(const std::string& folder) {
  return std::filesystem::path(HELIX_ARM_SOURCE_DIR) / ".." / "shared" / "data" / "real_tags" /
         folder;
}

/// Gray pictures of a folder by their names.
inline std::map<std::string, cv::Mat> picturesIn(const std::filesystem::path& folder) {
  std::map<std::string, cv::Mat> pictures;
  const auto source = vision::FrameSource::files(folder.string());
  vision::Frame frame;
  while (source->next(frame) != vision::FrameStatus::kEnd) {
    EXPECT_EQ(frame.fault, "");
    pictures[std::filesystem::path(frame.name).filename().string()] = frame.gray.clone();
  }
  return pictures;
}

/// Ids of family 36h11 that libapriltag finds by itself, with its own defaults.
inline std::multiset<int> plainIds(const cv::Mat& picture, double decimate) {
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

/// Of groundtruth.txt, which has a picture a line, then the ids in it.
inline std::map<std::string, std::multiset<int>> idsOf(const std::filesystem::path& path) {
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

/// Of a file with `id, (x y), (x y), (x y), (x y)` a line: what libapriltag said, but with the
/// centres of pixels at whole numbers [px].
inline std::vector<std::pair<int, estimation::Corners>> cornersOf(
    const std::filesystem::path& path) {
  std::vector<std::pair<int, estimation::Corners>> tags;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    for (char& c : line) {
      if (c == ',' || c == '(' || c == ')') c = ' ';
    }
    std::istringstream words(line);
    int id = 0;
    estimation::Corners corners;
    if (!(words >> id)) continue;
    for (int k = 0; k < 4; ++k) words >> corners(0, k) >> corners(1, k);
    EXPECT_TRUE(words) << path << ": " << line;
    tags.emplace_back(id, corners.array() - 0.5);
  }
  return tags;
}

}  // namespace helix_arm::test
