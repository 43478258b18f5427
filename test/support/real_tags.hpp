#pragma once

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <utility>

#include <opencv2/core.hpp>

#include "helix_arm/localization/tag_layout.hpp"

namespace helix_arm::test {

/// Photographs with licences of their own, which are not part of the project: where they are absent
/// there is nothing to test.
std::filesystem::path photographs(const std::string& folder);

/// Gray pictures of a folder by their names.
std::map<std::string, cv::Mat> picturesIn(const std::filesystem::path& folder);

/// Ids of family 36h11 that libapriltag finds by itself, with its own defaults.
std::multiset<int> plainIds(const cv::Mat& picture, double decimate);

/// Of groundtruth.txt, which has a picture a line, then the ids in it.
std::map<std::string, std::multiset<int>> idsOf(const std::filesystem::path& path);

/// Of a file with `id, (x y), (x y), (x y), (x y)` a line: what libapriltag said, but with the
/// centres of pixels at whole numbers [px].
std::vector<std::pair<int, estimation::Corners>> cornersOf(const std::filesystem::path& path);

}  // namespace helix_arm::test
