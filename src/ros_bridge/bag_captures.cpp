#include "helix_arm/ros_bridge/bag_captures.hpp"

#include <algorithm>
#include <iterator>
#include <map>
#include <set>

#include <rosbag/bag.h>
#include <rosbag/view.h>

#include "helix_arm/PressureArray.h"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/content_hash.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

// The topic of a bag that ends in this name and holds such messages; empty where there is none.
std::string topicOf(const rosbag::Bag& bag, const std::string& name, const std::string& type,
                    io::FaultList& faults) {
  std::set<std::string> found;
  rosbag::View all(bag);
  for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
    const std::string& topic = connection->topic;
    if (topic.substr(topic.rfind('/') + 1) == name && connection->datatype == type) {
      found.insert(topic);
    }
  }
  if (found.size() > 1) {
    faults.add(0, "topics " + *found.begin() + " and " + *found.rbegin() +
                      ": of more than one arm; record one arm a bag");
  }
  return found.empty() ? "" : *found.begin();
}

Eigen::VectorXd pressuresOf(const PressureArray& message, const std::string& topic,
                            const model::Arm& arm, const std::string& path) {
  const auto checked = control::checkReading(arm, message.name, message.pressure);
  if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
    throw io::DocumentError(path + " " + topic + " is not of this arm: " + refusal->message);
  }
  return std::get<Eigen::VectorXd>(checked);
}

}  // namespace

std::vector<control::TagSighting> sightingsOf(const TagDetections& detections,
                                              const io::Scene& scene) {
  std::map<int, control::TagSighting> found;
  for (const TagDetection& tag : detections.tags) {
    if (tag.repeated || !scene.tags || scene.tags->find(tag.id) < 0) continue;
    control::TagSighting& sighting = found[tag.id];
    sighting.id = tag.id;
    for (Eigen::Index k = 0; k < sighting.corners.size(); ++k) {
      sighting.corners(k) = tag.corners[static_cast<std::size_t>(k)];
    }
  }
  std::vector<control::TagSighting> out;
  for (const auto& [id, sighting] : found) {
    if (sighting.corners.allFinite()) out.push_back(sighting);
  }
  return out;
}

std::vector<io::TagCornerCapture> numbered(const std::vector<control::Sample>& samples,
                                           const model::Arm& arm) {
  std::vector<io::TagCornerCapture> out;
  for (const control::Sample& sample : samples) {
    io::TagCornerCapture& capture = out.emplace_back();
    capture.number = static_cast<int>(out.size());
    capture.pressure = arm.clamped(sample.pressure);
    for (const control::TagSighting& tag : sample.tags) {
      capture.tags.push_back({tag.id, tag.corners});
    }
  }
  return out;
}

std::vector<control::Sample> loadBag(const std::string& path, const io::Scene& scene,
                                     const control::SettleRules& rules) try {
  rosbag::Bag bag(path, rosbag::bagmode::Read);
  io::FaultList faults(path);
  const auto find = [&](const char* name, const std::string& type) {
    return topicOf(bag, name, type, faults);
  };
  using ros::message_traits::datatype;
  const std::string detections = find(names::kTagDetections, datatype<TagDetections>());
  const std::string measured = find(names::kPressureMeasured, datatype<PressureArray>());
  const std::string command = find(names::kPressureCommand, datatype<PressureArray>());
  const auto require = [&](const std::string& topic, const char* name) {
    if (topic.empty()) {
      faults.add(0, std::string("topic ") + name + " is missing; record it with the others");
    }
  };
  require(detections, names::kTagDetections);
  require(measured, names::kPressureMeasured);
  faults.throwIfAny();

  std::vector<std::string> actuators;
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    actuators.push_back(scene.arm.actuator(i).name);
  }
  control::SettleWatch watch(actuators, rules);
  std::vector<control::Sample> out, standing;
  const auto moveOn = [&] {
    if (!standing.empty()) out.push_back(medianOf(standing));
    standing.clear();
  };
  std::string last_reason = "no tag_detections came";
  rosbag::View view(bag,
                    rosbag::TopicQuery(std::vector<std::string>{detections, measured, command}));
  for (const rosbag::MessageInstance& instance : view) {
    if (const auto pressures = instance.instantiate<PressureArray>()) {
      const std::string& topic = instance.getTopic();
      const double time = pressures->header.stamp.toSec();
      const Eigen::VectorXd values = pressuresOf(*pressures, topic, scene.arm, path);
      topic == command ? watch.command(time, values) : watch.measured(time, values);
    } else if (const auto seen = instance.instantiate<TagDetections>()) {
      const double time = seen->header.stamp.toSec();
      watch.seen(time, sightingsOf(*seen, scene));
      const control::Settling settling = watch.at(time);
      if (settling.settled()) {
        standing.push_back(*settling.last);
      } else {
        moveOn();
        last_reason = settling.reason;
      }
    }
  }
  moveOn();
  if (out.empty()) {
    throw io::DocumentError(path + ": the arm never stands still in it; at last, " + last_reason);
  }
  return out;
} catch (const rosbag::BagException& fault) {
  throw io::DocumentError(path + ": " + fault.what() +
                          "; expected a bag that was closed (rosbag "
                          "reindex mends one that was not)");
}

io::CalibrationData loadMeasurements(const io::Scene& scene, const std::vector<std::string>& paths,
                                     const control::SettleRules& rules) {
  const std::string kRecording = ".bag";
  std::vector<std::string> tables, bags;
  for (const std::string& path : paths) {
    const bool is_bag =
        path.size() >= kRecording.size() &&
        path.compare(path.size() - kRecording.size(), kRecording.size(), kRecording) == 0;
    (is_bag ? bags : tables).push_back(path);
  }
  io::CalibrationData out = io::loadCalibrationData(scene, tables);
  for (const std::string& path : bags) {
    const auto seen = numbered(loadBag(path, scene, rules), scene.arm);
    io::LoadedCaptures loaded = io::makeCaptures(scene, seen, path);
    out.sources.push_back({path, io::sha256OfFile(path), static_cast<int>(loaded.captures.size())});
    io::addCaptures(std::move(loaded.captures), path, out);
  }
  return out;
}

}  // namespace helix_arm::ros_bridge
