#include "helix_arm/vision/tag_tracker.hpp"

namespace helix_arm::vision {

struct TagTracker::Workspace {
  TagDetector detector;
  TrackResult result;
};

TagTracker::TagTracker(const DetectorConfig& config, TrackingMode)
    : work_(std::make_unique<Workspace>(Workspace{TagDetector(config), {}})) {}
TagTracker::~TagTracker() = default;
TagTracker::TagTracker(TagTracker&&) noexcept = default;
TagTracker& TagTracker::operator=(TagTracker&&) noexcept = default;
const TagFamily& TagTracker::family() const { return work_->detector.family(); }
const TrackResult& TagTracker::track(const cv::Mat& gray, const std::vector<ExpectedTag>&) {
  return search(gray);
}
const TrackResult& TagTracker::search(const cv::Mat& gray) {
  work_->result = {work_->detector.detect(gray), 0, 0, true};
  return work_->result;
}

}  // namespace helix_arm::vision
