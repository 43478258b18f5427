#include "bag_captures.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <sstream>
#include <utility>

#include <unistd.h>

#include "basics/quote.hpp"
#include "basics/regular_file.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "io/data/body_table.hpp"
#include "io/document/atomic_file.hpp"
#include "nlohmann/json.hpp"
#include "procedures/body_recording.hpp"
#include "procedures/report_plot.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

namespace {

using nlohmann::json;

constexpr std::uint64_t kMostBagBytes = 16ULL << 30U;

// Topics that are read of a recording: a topic by its name behind the last `/`, its type, and the
// checksum of the definition in msg/, which bag_captures_test compares: the command is built
// without ROS too.
enum Topic { kDetections, kTagPoses, kMeasured, kCommand, kBodies, kJoints, kTopicCount };
const char* const kTags[] = {"helix_arm/TagDetections", "c1e7488b8f93702d089fe2e6bc94cf25"};
// Poses of tags seen from the camera, which another detector tells.
const char* const kPoses[] = {"apriltag_ros/AprilTagDetectionArray",
                              "2b6c03434883a5c9897c13b5594dbd91"};
const char* const kBodySets[] = {"helix_arm/BodyPoses", "ee1b2d9e3e0156d0b1c119adb2da6c5a"};
const char* const kJointSets[] = {"sensor_msgs/JointState", "3066dcd76a6cfaef579bd0f34173e9fd"};
const char* const kPressures[] = {"helix_arm/PressureArray", "16e7dc420c1fb29f7ee29e1f1b50f307"};
const struct {
  const char* name;
  const char* const* type;
} kTopics[] = {{names::kTagDetections, kTags},         {names::kTagDetections, kPoses},
               {names::kPressureMeasured, kPressures}, {names::kPressureCommand, kPressures},
               {names::kBodyPoses, kBodySets},         {names::kJointStates, kJointSets}};
// The pose of a body, as motion-capture systems publish it on NAME/pose. After kTopics, one each.
const char* const kPose[] = {"geometry_msgs/PoseStamped", "d3812c3cbc69362b77dc0b19b345f8f5"};
constexpr double kTogether = 0.005;  // longest time between stamps of poses in one row [s]

using Topics = std::vector<std::array<std::string, 3>>;  // name, type, checksum

Topics topicsFor(const io::Scene& scene) {
  Topics out;
  for (const auto& [name, type] : kTopics) out.push_back({name, type[0], type[1]});
  if (!scene.hasBodies()) return out;
  for (const auto& body : scene.tags->tags)
    out.push_back({body.name + "/pose", kPose[0], kPose[1]});
  return out;
}

// Output of scripts/read_bag of a file that is open: its path may lead to another one meanwhile.
std::string printedOf(const basics::RegularFile& file, const std::string& path,
                      const Topics& topics) try {
  const std::string opened =
      "/proc/" + std::to_string(getpid()) + "/fd/" + std::to_string(file.descriptor());
  const json request{{"bag", opened}, {"topics", topics}};
  return procedures::runScript(
      "read_bag", request.dump(), {},
      "is damaged: reading it did not end; expected an intact bag (rosbag check examines it, "
      "rosbag reindex may repair it)");
} catch (const std::exception& fault) {
  throw io::DocumentError(path + " " + basics::printable(fault.what()));
}

// Why there is no topic of a kind: it is missing, or of a type that is not read.
std::string faultOfTopic(const std::string& name, const Topics& topics, const json& others) {
  std::string expected;
  for (const auto& [one, type, checksum] : topics) {
    if (one == name) expected += (expected.empty() ? "" : " or ") + type;
  }
  for (const json& other : others) {
    if (other[2] != name) continue;
    return "topic " + basics::quoted(other[0]) + " has the type " + basics::quoted(other[1]) +
           "; expected " + expected +
           ": record the topic of the nodes of this package, or relay it";
  }
  return "topic " + name + " is missing; record it with the others";
}

// The topic of each kind; empty if absent, which is a fault where nothing else tells the same.
// @param pressures  whether they have to be in the recording.
std::vector<std::string> topicsOf(const json& found, const std::string& path, const Topics& topics,
                                  bool pressures) {
  io::FaultList faults(path);
  std::vector<std::string> out(topics.size());
  for (const json& one : found["topics"]) {
    const auto place = one[0].get<std::size_t>();
    const std::string name = one[1];
    for (std::size_t other = 0; other < topics.size(); ++other) {
      if (out[other].empty() || topics[other][0] != topics[place][0]) continue;
      faults.add(0, "topics " + basics::quoted(out[other]) + " and " + basics::quoted(name) +
                        " belong to more than one arm; record one arm per bag");
    }
    out[place] = name;
  }
  const auto need = [&](std::size_t place) {
    if (out[place].empty()) faults.add(0, faultOfTopic(topics[place][0], topics, found["others"]));
  };
  if (topics.size() == kTopicCount) {
    if (out[kTagPoses].empty()) need(kDetections);
  } else if (out[kBodies].empty()) {
    for (std::size_t body = kTopicCount; body < topics.size(); ++body) need(body);
  }
  if (pressures && out[kJoints].empty()) need(kMeasured);
  faults.throwIfAny();
  return out;
}

double numberOf(const json& value) {
  return value.is_string() ? std::stod(value.get<std::string>()) : value.get<double>();
}

// @param pose  position, then quaternion x, y, z, w.
lie::SE3 poseOf(const json& pose) {
  const Eigen::Quaterniond q(numberOf(pose[6]), numberOf(pose[3]), numberOf(pose[4]),
                             numberOf(pose[5]));
  return {q.normalized().toRotationMatrix(),
          {numberOf(pose[0]), numberOf(pose[1]), numberOf(pose[2])}};
}

std::vector<SeenTag> detectionsOf(const json& tags) {
  std::vector<SeenTag> out;
  for (const json& tag : tags) {
    SeenTag& one = out.emplace_back();
    one.observation.id = tag[0];
    one.repeated = tag[1];
    for (int k = 0; k < 8; ++k) one.observation.corners(k) = numberOf(tag[2][k]);
  }
  return out;
}

struct SeenBody {
  double time;
  int body;  // index in the scene
  lie::SE3 X_FM;
};

void addBodies(const json& names, const json& poses, double time, const io::Scene& scene,
               std::vector<SeenBody>& out) {
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto& bodies = scene.tags->tags;
    const auto body = std::find_if(bodies.begin(), bodies.end(), [&](const auto& one) {
      return one.name == names[i].get<std::string>();
    });
    if (body != bodies.end()) out.push_back({time, body->id, poseOf(poses[i])});
  }
}

io::BodyTable tableOf(std::vector<SeenBody> seen, std::size_t bodies) {
  std::stable_sort(seen.begin(), seen.end(),
                   [](const SeenBody& a, const SeenBody& b) { return a.time < b.time; });
  io::BodyTable out;
  for (const auto& [time, body, X_FM] : seen) {
    if (!X_FM.rotation.allFinite() || !X_FM.translation.allFinite()) continue;  // lost
    const auto column = static_cast<std::size_t>(body);
    if (out.time.empty() || time - out.time.back() > kTogether || out.poses.back()[column]) {
      out.time.push_back(time);
      out.poses.emplace_back(bodies);
    }
    out.poses.back()[column] = X_FM;
  }
  return out;
}

// Where the camera of the scene sees the corners of tags whose poses another detector has told.
std::vector<SeenTag> seenAt(const json& tags, const io::Scene& scene, const std::string& path) {
  if (!scene.camera) {
    throw io::DocumentError(path + " has poses of tags seen from a camera, but scene " +
                            scene.name + " has no camera; expected a scene with a section camera");
  }
  std::vector<SeenTag> out;
  std::map<int, std::size_t> known;
  for (const json& tag : tags) {
    const lie::SE3 X_CT = poseOf(tag[2]);
    SeenTag one;
    one.observation.id = tag[0];
    estimation::TagLayout plane;
    plane.size = numberOf(tag[1]);
    const estimation::Corners corners = plane.corners();
    for (int c = 0; c < 4; ++c) {
      const auto pixel =
          scene.camera->model.project(X_CT * Eigen::Vector3d(corners(0, c), corners(1, c), 0.0));
      one.observation.corners.col(c) =
          pixel.value_or(Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN()));
    }
    const auto [first, is_new] = known.emplace(one.observation.id, out.size());
    if (!is_new) one.repeated = out[first->second].repeated = true;
    out.push_back(one);
  }
  return out;
}

Eigen::VectorXd pressuresOf(const json& names, const json& values, const std::string& topic,
                            const model::Arm& arm, const std::string& path) {
  std::vector<double> pressures;
  for (const json& value : values) pressures.push_back(numberOf(value));
  const auto checked = control::checkReading(arm, names, pressures);
  if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
    throw io::DocumentError(path + " " + topic + " is not of this arm: " + refusal->message);
  }
  return std::get<Eigen::VectorXd>(checked);
}

// The same of joint states, which have bends and twists beside the actuators.
Eigen::VectorXd jointPressuresOf(const json& names, const json& values, const std::string& topic,
                                 const model::Arm& arm, const std::string& path) {
  json own = json::array(), pressures = json::array();
  for (std::size_t i = 0; i < names.size(); ++i) {
    for (int k = 0; k < arm.actuatorCount(); ++k) {
      if (names[i] != arm.actuator(k).name) continue;
      own.push_back(names[i]);
      pressures.push_back(values[i]);
    }
  }
  return pressuresOf(own, pressures, topic, arm, path);
}

// The messages that scripts/read_bag printed, one after the other; null at the end.
class Messages {
 public:
  explicit Messages(std::string text) : text_(std::move(text)), at_(text_.begin()) {}
  Messages(const Messages&) = delete;
  Messages& operator=(const Messages&) = delete;

  json next() {
    const auto begin = std::exchange(at_, std::find(at_, text_.end(), '\n'));
    return begin == text_.end() ? json() : json::parse(begin, at_ == text_.end() ? at_ : at_++);
  }

 private:
  const std::string text_;
  std::string::const_iterator at_;
};

std::vector<procedures::Sample> bodySamplesOf(Messages& messages, const std::string& path,
                                              const std::vector<std::string>& topics,
                                              const io::Scene& scene,
                                              const procedures::RecordedPressures& pressures,
                                              const procedures::SettleRules& rules,
                                              std::vector<std::string>& notes) {
  std::vector<SeenBody> seen;
  std::vector<std::pair<double, Eigen::VectorXd>> read;
  const Topic taken = topics[kMeasured].empty() ? kJoints : kMeasured;
  for (json record = messages.next(); !record.is_null(); record = messages.next()) {
    const std::size_t topic = record[0];
    const double time = record[1];
    if (topic == taken) {
      const auto of = topic == kJoints ? jointPressuresOf : pressuresOf;
      read.emplace_back(time, of(record[2], record[3], topics[topic], scene.arm, path));
    } else if (topic == kBodies) {
      addBodies(record[2], record[3], time, scene, seen);
    } else if (topic >= kTopicCount && topics[kBodies].empty()) {
      seen.push_back({time, static_cast<int>(topic - kTopicCount), poseOf(record[2])});
    }
  }
  std::stable_sort(read.begin(), read.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  procedures::TimedPressures own;
  own.values.resize(static_cast<Eigen::Index>(read.size()), scene.arm.actuatorCount());
  for (const auto& [time, values] : read) {
    own.values.row(static_cast<Eigen::Index>(own.time.size())) = values;
    own.time.push_back(time);
  }
  const io::BodyTable table = tableOf(std::move(seen), scene.tags->tags.size());
  if (table.time.empty() || (own.time.empty() && pressures.path.empty())) {
    throw io::DocumentError(path + " has no " + (table.time.empty() ? "pose" : "pressure") +
                            " in it; expected a recording of the arm at rest at several pressures");
  }
  return procedures::samplesAtRest(scene, table, path, own, pressures, rules, notes);
}

std::vector<procedures::Sample> tagSamplesOf(Messages& messages, const std::string& path,
                                             const std::vector<std::string>& topics,
                                             const io::Scene& scene,
                                             const procedures::SettleRules& rules) {
  procedures::SettleWatch watch(scene.arm, rules);
  std::vector<procedures::Sample> out, standing;
  const auto moveOn = [&] {
    if (!standing.empty()) out.push_back(medianOf(standing));
    standing.clear();
  };
  std::string last_reason = "there are no tag_detections";
  for (json record = messages.next(); !record.is_null(); record = messages.next()) {
    const Topic topic = record[0];
    const double time = record[1];
    if (topic == kMeasured || topic == kCommand) {
      const Eigen::VectorXd values =
          pressuresOf(record[2], record[3], topics[topic], scene.arm, path);
      topic == kCommand ? watch.command(time, values) : watch.measured(time, values);
      continue;
    }
    if (topic != kDetections && topic != kTagPoses) continue;
    const std::vector<SeenTag> tags =
        topic == kDetections ? detectionsOf(record[2]) : seenAt(record[2], scene, path);
    watch.seen(time, observationsOf(tags, scene));
    const procedures::Settling settling = watch.at(time);
    if (settling.settled()) {
      standing.push_back(*settling.last);
    } else {
      moveOn();
      last_reason = settling.reason;
    }
  }
  moveOn();
  if (out.empty()) {
    throw io::DocumentError(path + ": the arm is never at rest in it; at its end, " + last_reason);
  }
  return out;
}

std::vector<procedures::Sample> samplesOf(const basics::RegularFile& file, const std::string& path,
                                          const io::Scene& scene,
                                          const procedures::RecordedPressures& pressures,
                                          const procedures::SettleRules& rules,
                                          std::vector<std::string>& notes) {
  const Topics wanted = topicsFor(scene);
  Messages messages(printedOf(file, path, wanted));
  const std::vector<std::string> topics =
      topicsOf(messages.next(), path, wanted, !scene.hasBodies() || pressures.path.empty());
  return scene.hasBodies() ? bodySamplesOf(messages, path, topics, scene, pressures, rules, notes)
                           : tagSamplesOf(messages, path, topics, scene, rules);
}

bool isBag(const std::string& path) {
  const std::string ending = ".bag";
  return path.size() >= ending.size() &&
         path.compare(path.size() - ending.size(), ending.size(), ending) == 0;
}

void requireOpen(const basics::RegularFile& file, const std::string& path) {
  if (!file.isOpen()) throw io::DocumentError(path + " " + file.fault());
  if (file.size() > kMostBagBytes) {
    throw io::DocumentError(path + " " + basics::largerThan(kMostBagBytes) +
                            "; expected a shorter recording");
  }
}

}  // namespace

std::vector<procedures::TagObservation> observationsOf(const std::vector<SeenTag>& detections,
                                                       const io::Scene& scene) {
  std::map<int, procedures::TagObservation> found;
  for (const auto& [tag, repeated] : detections) {
    if (!repeated && scene.tags && scene.tags->find(tag.id) >= 0) found[tag.id] = tag;
  }
  std::vector<procedures::TagObservation> out;
  for (const auto& [id, observation] : found) {
    const bool finite =
        observation.corners.allFinite() && (!observation.points || observation.points->allFinite());
    if (finite) out.push_back(observation);
  }
  return out;
}

SampleTable::SampleTable(const std::vector<procedures::Sample>& samples, const io::Scene& scene) {
  for (const procedures::Sample& sample : samples) {
    const int number = size() + 1;
    const Eigen::VectorXd pressure = scene.arm.clamped(sample.pressure);
    if (scene.hasBodies()) {
      poses.push_back({number, pressure, {}, sample.time});
      for (const procedures::TagObservation& body : sample.tags) {
        poses.back().tags.push_back({body.id, body.X_FM(), 0});
      }
      continue;
    }
    corners.push_back({number, pressure, {}, sample.time});
    for (const procedures::TagObservation& tag : sample.tags) {
      corners.back().tags.push_back({tag.id, tag.corners});
    }
  }
}

std::string SampleTable::csv(int actuators, const std::string& comment) const {
  return poses.empty() ? io::tagCornerCsv(corners, actuators, comment)
                       : io::tagPoseCsv(poses, actuators, comment);
}

procedures::LoadedCaptures SampleTable::captures(const io::Scene& scene,
                                                 const std::string& name) const {
  return poses.empty() ? procedures::makeCaptures(scene, corners, name)
                       : procedures::makeCaptures(scene, poses, name);
}

std::vector<procedures::Sample> loadBag(const std::string& path, const io::Scene& scene,
                                        const procedures::SettleRules& rules) {
  const basics::RegularFile file(path);
  requireOpen(file, path);
  std::vector<std::string> notes;
  return samplesOf(file, path, scene, {}, rules, notes);
}

io::DataSet loadDataSet(const io::Scene& scene, const std::string& path,
                        const procedures::RecordedPressures& pressures,
                        std::vector<std::string>& notes) {
  if (!isBag(path)) return procedures::measurementsOf(scene, path, pressures, notes);
  const basics::RegularFile file(path);
  requireOpen(file, path);
  const SampleTable seen(samplesOf(file, path, scene, pressures, {}, notes), scene);
  std::istringstream table(seen.csv(scene.arm.actuatorCount(), ""));
  return io::readDataSet(table, path);
}

procedures::CalibrationData loadMeasurements(const io::Scene& scene,
                                             const std::vector<std::string>& paths,
                                             const procedures::SettleRules& rules,
                                             const procedures::RecordedPressures& pressures) {
  std::vector<std::string> tables, bags;
  for (const std::string& path : paths) (isBag(path) ? bags : tables).push_back(path);
  procedures::CalibrationData out = procedures::loadCalibrationData(scene, tables, pressures);
  for (const std::string& path : bags) {
    basics::RegularFile file(path);
    requireOpen(file, path);
    const std::string sha256 = io::sha256OfFile(file, path, kMostBagBytes);
    const SampleTable seen(samplesOf(file, path, scene, pressures, rules, out.warnings), scene);
    if (!file.isUnchanged()) {
      throw io::DocumentError(path + " changed while it was read; expected one that is closed");
    }
    procedures::LoadedCaptures loaded = seen.captures(scene, path);
    out.sources.push_back({path, sha256, static_cast<int>(loaded.captures.size())});
    procedures::addCaptures(std::move(loaded.captures), path, out);
  }
  return out;
}

}  // namespace helix_arm::ros_bridge
