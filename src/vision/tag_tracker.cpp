#include "tag_tracker.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace helix_arm::vision {
namespace {

using estimation::Corners;

// Margin of a region around a tag, in tag sizes, and for small tags in px; the cost is quadratic.
constexpr double kRegionMargin = 0.5;
constexpr double kLeastRegionMargin = 16.0;
// Constant cost of a search, expressed as area: regions are merged if that is cheaper [px^2].
constexpr int kRegionOverhead = 500;
// Tags that were not found last time may stay invisible for long. One of them at a time is searched
// in its region, and the whole picture once a second at 30 Hz: a thirtieth of its cost each time.
constexpr int kWholeEvery = 30;
// If no tag is missing, a whole search only serves to notice unexpected tags.
constexpr int kWholeForStrangersEvery = 90;
// Smaller displacements would not have prevented the edge search [px].
constexpr double kDisplaced = 4.0;

Eigen::Vector2d middle(const Corners& corners) { return corners.rowwise().mean(); }

double distance(const Corners& a, const Corners& b) { return (middle(a) - middle(b)).norm(); }

// Whether both are the same tag rather than a copy.
bool samePlace(const Corners& a, const Corners& b) {
  return distance(a, b) < 0.5 * (a.col(1) - a.col(0)).norm();
}

// Empty if the tag is expected far outside the picture.
cv::Rect regionOf(const Corners& corners, const cv::Size& picture) {
  if (!corners.allFinite()) return {};
  const Eigen::Vector2d low = corners.rowwise().minCoeff(), high = corners.rowwise().maxCoeff();
  const double margin = std::max(kRegionMargin * (high - low).maxCoeff(), kLeastRegionMargin);
  const auto within = [](double value, int size) {
    return static_cast<int>(std::lround(std::clamp(value, 0.0, static_cast<double>(size))));
  };
  return {
      cv::Point(within(low.x() - margin, picture.width), within(low.y() - margin, picture.height)),
      cv::Point(within(high.x() + margin, picture.width),
                within(high.y() + margin, picture.height))};
}

void join(std::vector<cv::Rect>& regions) {
  for (std::size_t i = 0; i < regions.size(); ++i) {
    for (std::size_t j = i + 1; j < regions.size(); ++j) {
      const cv::Rect both = regions[i] | regions[j];
      if (both.area() > regions[i].area() + regions[j].area() + kRegionOverhead) continue;
      regions[i] = both;
      regions.erase(regions.begin() + static_cast<std::ptrdiff_t>(j));
      j = i;  // it may now touch others
    }
  }
}

}  // namespace

struct TagTracker::Workspace {
  Workspace(const DetectorConfig& config, TrackingMode tracking_mode)
      : detector(config),
        mode(tracking_mode),
        closed_border(hasClosedBorder(detector.family())),
        cells_by_id(closed_border ? detector.family().count() : 0) {}

  const TagCells& cells(int id) {
    TagCells& known = cells_by_id[id];
    if (known.empty()) known = cellsOf(detector.family(), id);
    return known;
  }

  // Detections, without tags that are displaced by something along their sides.
  std::vector<TagDetection> detectTrue(const cv::Mat& gray, const cv::Rect& region) {
    std::vector<TagDetection> tags = detector.detect(gray, region);
    if (!closed_border) return tags;
    const auto displaced = [&](const TagDetection& tag) {
      return !cornersHold(gray, cells(tag.id), tag.corners);
    };
    tags.erase(std::remove_if(tags.begin(), tags.end(), displaced), tags.end());
    return tags;
  }

  void begin() {
    result.tags.clear();
    result.by_edges = result.by_regions = 0;
    result.whole_picture = false;
  }

  void lockOnTag(const cv::Mat& gray, const ExpectedTag& tag, std::size_t i,
                 const Eigen::Vector2d& displacement) {
    if (tag.id < 0 || tag.id >= detector.family().count()) return;
    const Corners expected = tag.corners.colwise() + displacement;
    const auto lock = lockOnEdges(gray, detector.family(), tag.id, cells(tag.id), expected,
                                  detector.config().max_hamming);
    if (lock) take(*lock, i, Way::kEdges);
  }

  // Looks for tags that are still missing at the displacement of the nearest tag that was found.
  void lockOnDisplacedTags(const cv::Mat& gray, const std::vector<ExpectedTag>& expected) {
    for (std::size_t i = 0; i < expected.size(); ++i) {
      if (way[i] != Way::kNone) continue;
      double nearest = std::numeric_limits<double>::infinity();
      Eigen::Vector2d displacement = Eigen::Vector2d::Zero();
      for (std::size_t j = 0; j < expected.size(); ++j) {
        if (way[j] == Way::kNone) continue;
        const double away = distance(expected[i].corners, expected[j].corners);
        if (!(away < nearest)) continue;
        nearest = away;
        displacement = middle(result.tags[place[j]].corners) - middle(expected[j].corners);
      }
      if (displacement.norm() < kDisplaced) continue;
      lockOnTag(gray, expected[i], i, displacement);
    }
  }

  void searchRegions(const cv::Mat& gray, const std::vector<ExpectedTag>& expected) {
    regions.clear();
    const auto add = [&](const ExpectedTag& tag) {
      const cv::Rect region = regionOf(tag.corners, gray.size());
      if (!region.empty()) regions.push_back(region);
    };
    unseen.clear();
    for (std::size_t i = 0; i < expected.size(); ++i) {
      if (way[i] != Way::kNone) continue;
      if (expected[i].seen_before) add(expected[i]);
      if (!expected[i].seen_before) unseen.push_back(i);
    }
    if (!unseen.empty()) add(expected[unseen[turn++ % unseen.size()]]);
    join(regions);
    candidates.clear();
    for (const cv::Rect& region : regions) {
      const std::vector<TagDetection> tags = detectTrue(gray, region);
      candidates.insert(candidates.end(), tags.begin(), tags.end());
    }
    for (std::size_t i = 0; i < expected.size(); ++i) {
      if (way[i] != Way::kNone) continue;
      const TagDetection* nearest = nullptr;
      for (const TagDetection& tag : candidates) {
        if (tag.id != expected[i].id) continue;
        if (nearest == nullptr || distance(tag.corners, expected[i].corners) <
                                      distance(nearest->corners, expected[i].corners)) {
          nearest = &tag;
        }
      }
      if (nearest != nullptr) take(*nearest, i, Way::kRegions);
    }
  }

  bool wholeIsDue(const std::vector<ExpectedTag>& expected) {
    ++since_whole;
    if (result.tags.empty()) return true;
    bool missing = false;
    for (std::size_t i = 0; i < expected.size(); ++i) {
      if (way[i] != Way::kNone) continue;
      if (expected[i].seen_before) return true;
      missing = true;
    }
    return since_whole >= (missing ? kWholeEvery : kWholeForStrangersEvery);
  }

  void searchWhole(const cv::Mat& gray) {
    since_whole = 0;
    candidates = detectTrue(gray, cv::Rect({0, 0}, gray.size()));
    // Tags that were only found by their edges or in a region are kept.
    const auto found = candidates.end() - candidates.begin();
    for (std::size_t i = 0; i < way.size(); ++i) {
      if (way[i] == Way::kNone) continue;
      const TagDetection& tag = result.tags[place[i]];
      const bool again = std::any_of(
          candidates.begin(), candidates.begin() + found, [&tag](const TagDetection& other) {
            return other.id == tag.id && samePlace(other.corners, tag.corners);
          });
      if (again) {
        --(way[i] == Way::kEdges ? result.by_edges : result.by_regions);
      } else {
        candidates.push_back(tag);
      }
    }
    std::swap(result.tags, candidates);
    result.whole_picture = true;
  }

  const TrackResult& finish() {
    std::sort(
        result.tags.begin(), result.tags.end(), [](const TagDetection& a, const TagDetection& b) {
          return std::make_pair(a.id, a.corners(0, 0)) < std::make_pair(b.id, b.corners(0, 0));
        });
    return result;
  }

  enum class Way { kNone, kEdges, kRegions };

  void take(const TagDetection& tag, std::size_t i, Way by) {
    way[i] = by;
    place[i] = result.tags.size();
    result.tags.push_back(tag);
    ++(by == Way::kEdges ? result.by_edges : result.by_regions);
  }

  TagDetector detector;
  TrackingMode mode;
  bool closed_border;
  std::vector<TagCells> cells_by_id;  // once requested
  TrackResult result;
  std::vector<Way> way;            // how each expected tag was found
  std::vector<std::size_t> place;  // index in the result, before the whole picture was searched
  std::vector<cv::Rect> regions;
  std::vector<TagDetection> candidates;
  std::vector<std::size_t> unseen;  // indices of the tags that were not found last time
  std::size_t turn = 0;             // of these
  int since_whole = 0;              // pictures
};

TagTracker::TagTracker(const DetectorConfig& config, TrackingMode mode)
    : work_(std::make_unique<Workspace>(config, mode)) {}
TagTracker::~TagTracker() = default;

const TrackResult& TagTracker::track(const cv::Mat& gray,
                                     const std::vector<ExpectedTag>& expected) {
  Workspace& work = *work_;
  if (work.mode == TrackingMode::kFull || expected.empty()) return search(gray);
  work.detector.detect(gray, {});  // refuses pictures of another type
  work.begin();
  work.way.assign(expected.size(), Workspace::Way::kNone);
  work.place.assign(expected.size(), 0);
  const bool by_edges = work.mode == TrackingMode::kEdges && work.closed_border;
  if (by_edges) {
    for (std::size_t i = 0; i < expected.size(); ++i) {
      work.lockOnTag(gray, expected[i], i, Eigen::Vector2d::Zero());
    }
    work.lockOnDisplacedTags(gray, expected);
  }
  work.searchRegions(gray, expected);
  if (by_edges && work.result.by_regions > 0) work.lockOnDisplacedTags(gray, expected);
  if (work.wholeIsDue(expected)) work.searchWhole(gray);
  return work.finish();
}

const TrackResult& TagTracker::search(const cv::Mat& gray) {
  work_->begin();
  work_->result.tags = work_->detector.detect(gray);
  work_->result.whole_picture = true;
  work_->since_whole = 0;
  return work_->result;
}

}  // namespace helix_arm::vision
