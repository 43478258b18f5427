#include "ros_bridge/follow/tag_matcher.hpp"

#include <algorithm>
#include <utility>

namespace helix_arm::ros_bridge {

std::optional<std::vector<int>> fittedTags(const TagDetections& detections,
                                           const estimation::TagLayout& layout) {
  std::vector<int> out;
  for (const TagDetection& tag : detections.tags) {
    if (!tag.fitted) continue;
    const int index = layout.find(tag.id);
    if (index < 0) return std::nullopt;
    // Of a message with any number of tags, no more than the layout has are kept.
    const auto place = std::lower_bound(out.begin(), out.end(), index);
    if (place == out.end() || *place != index) out.insert(place, index);
  }
  if (out.empty()) return std::nullopt;
  return out;
}

void TagMatcher::add(SeenArm seen, double now) { shapes_.push_back({std::move(seen), now}); }

void TagMatcher::addTags(const ros::Time& stamp, std::optional<std::vector<int>> tags, double now) {
  if (!tags_.empty() && stamp < tags_.back().stamp) tags_.clear();  // a jump back in time
  tags_.push_back({stamp, std::move(tags)});
  if (tags_.size() > kMost) tags_.pop_front();
  last_tags_ = now;
}

bool TagMatcher::mayGetTags(const Waiting& shape, double now) const {
  const bool come = last_tags_ && now - *last_tags_ <= kSilence;
  const bool passed = !tags_.empty() && tags_.back().stamp > shape.seen.stamp;
  return come && !passed && now - shape.since <= kPatience && shapes_.size() <= kMost;
}

std::optional<SeenArm> TagMatcher::take(double now) {
  if (shapes_.empty()) return std::nullopt;
  Waiting& first = shapes_.front();
  const auto of_it = std::find_if(tags_.begin(), tags_.end(), [&first](const Tags& tags) {
    return tags.stamp == first.seen.stamp;
  });
  if (of_it == tags_.end() && mayGetTags(first, now)) return std::nullopt;
  std::optional<SeenArm> out = std::move(first.seen);
  shapes_.pop_front();
  if (of_it != tags_.end()) out->tags = of_it->fitted;
  return out;
}

void TagMatcher::clear() {
  shapes_.clear();
  tags_.clear();
}

}  // namespace helix_arm::ros_bridge
