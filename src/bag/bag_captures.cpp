#include "bag_captures.hpp"

#include <array>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <map>
#include <optional>
#include <system_error>
#include <utility>

#include <dlfcn.h>
#include <sys/wait.h>

#include "bag_records.hpp"
#include "helix_arm/basics/child_process.hpp"
#include "helix_arm/basics/quote.hpp"
#include "helix_arm/basics/regular_file.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

namespace {

/// A record of a recording. Its bytes come from a process that read a file of unknown make.
struct BagRecord {
  RecordKind kind;
  RecordTopic topic;
  std::vector<std::uint8_t> bytes;
};

constexpr int kSilence = 300'000;  // [ms] without output, after which the reader is killed

// bag_reader is installed with the programs of this package.
std::string readerProgram() {
  Dl_info library{};
  dladdr(reinterpret_cast<const void*>(&readerProgram), &library);
  std::error_code ignored;
  const std::filesystem::path here =
      std::filesystem::weakly_canonical(library.dli_fname, ignored).parent_path();
  return (here / "helix_arm/bag_reader").string();
}

/// Has a rosbag read by bag_reader, a process of its own, which does not outlive the object.
/// Whatever the bag holds, this process goes on.
class BagProcess {
 public:
  /// @param path  of the file, for messages.
  /// @throws io::DocumentError where no process can be started.
  BagProcess(const basics::RegularFile& file, std::string path) : path_(std::move(path)) {
    const std::string program = readerProgram();
    try {
      process_.emplace(std::vector<std::string>{program},
                       basics::ChildProcess::Options{file.descriptor(), true});
    } catch (const std::system_error& error) {
      refuse("cannot be read: " + program + " does not start: " + error.code().message() +
             "; install helix_arm again");
    }
  }

  ~BagProcess() {
    if (process_) process_->kill();
  }

  BagProcess(const BagProcess&) = delete;
  BagProcess& operator=(const BagProcess&) = delete;

  /// The next record; kEnd is the last.
  /// @throws io::DocumentError naming the bag where reading it failed: it is damaged, and took the
  /// process down, more memory or time than it may.
  BagRecord next() {
    RecordHead head{};
    read(&head, sizeof head);
    const bool sound =
        head.bytes <= kMostRecordBytes && static_cast<int>(head.topic) < kRecordTopics;
    if (!sound) {
      process_->kill();
      refuse("is damaged: its content is not valid; expected an intact bag");
    }
    BagRecord record{head.kind, head.topic, std::vector<std::uint8_t>(head.bytes)};
    read(record.bytes.data(), record.bytes.size());
    if (record.kind == RecordKind::kFault) {
      const std::string fault(record.bytes.begin(), record.bytes.end());
      refuse("cannot be read: " + basics::quoted(fault, 200) +
             "; expected a bag that was closed (rosbag reindex repairs one that was not)");
    }
    return record;
  }

 private:
  void read(void* bytes, std::size_t size) {
    auto* place = static_cast<char*>(bytes);
    while (size > 0) {
      const auto count = process_->read(place, size, kSilence);
      if (!count) refuse("takes too long to read; expected an intact bag");
      if (*count == 0) failed();
      place += *count;
      size -= *count;
    }
  }

  [[noreturn]] void failed() {
    const int status = process_->status(kSilence).value_or(0);
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU) {
      refuse("takes more than " + std::to_string(kMostReaderTime) +
             " s of processor time to read; expected a shorter or an intact bag");
    }
    const std::string reason =
        WIFSIGNALED(status) ? std::string("reading it ended with ") + strsignal(WTERMSIG(status))
                            : "reading it did not end";
    refuse("is damaged: " + reason +
           "; expected an intact bag (rosbag check examines it, rosbag reindex "
           "may repair it)");
  }

  [[noreturn]] void refuse(const std::string& fault) const {
    throw io::DocumentError(path_ + " " + fault);
  }

  const std::string path_;
  std::optional<basics::ChildProcess> process_;
};

constexpr std::uint64_t kMostBagBytes = 16ULL << 30U;

// The topic of each kind; empty if absent, which is a fault except for commands.
using Topics = std::array<std::string, kRecordTopics>;

Topics topicsOf(BagProcess& bag, const std::string& path) {
  io::FaultList faults(path);
  Topics out;
  for (BagRecord record = bag.next(); record.kind != RecordKind::kTopicsEnd; record = bag.next()) {
    const std::string name(record.bytes.begin(), record.bytes.end());
    std::string& topic = out[static_cast<std::size_t>(record.topic)];
    if (!topic.empty()) {
      faults.add(0, "topics " + basics::quoted(topic) + " and " + basics::quoted(name) +
                        " belong to more than one arm; record one arm per bag");
    }
    topic = name;
  }
  for (const RecordTopic needed : {RecordTopic::kDetections, RecordTopic::kMeasured}) {
    if (!out[static_cast<std::size_t>(needed)].empty()) continue;
    faults.add(
        0, std::string("topic ") + ruleOf(needed).name + " is missing; record it with the others");
  }
  faults.throwIfAny();
  return out;
}

template <class Message>
Message messageOf(BagRecord& record, const std::string& path) try {
  Message message;
  ros::serialization::IStream stream(record.bytes.data(),
                                     static_cast<std::uint32_t>(record.bytes.size()));
  ros::serialization::deserialize(stream, message);
  return message;
} catch (const std::exception&) {
  throw io::DocumentError(path +
                          " is damaged: a message is not of the type that its header states");
}

Eigen::VectorXd pressuresOf(const PressureArray& message, const std::string& topic,
                            const model::Arm& arm, const std::string& path) {
  const auto checked = control::checkReading(arm, message.name, message.pressure);
  if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
    throw io::DocumentError(path + " " + topic + " is not of this arm: " + refusal->message);
  }
  return std::get<Eigen::VectorXd>(checked);
}

std::vector<procedures::Sample> samplesOf(const basics::RegularFile& file, const std::string& path,
                                          const io::Scene& scene,
                                          const procedures::SettleRules& rules) {
  BagProcess bag(file, path);
  const Topics topics = topicsOf(bag, path);
  std::vector<std::string> actuators;
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    actuators.push_back(scene.arm.actuator(i).name);
  }
  procedures::SettleWatch watch(actuators, rules);
  std::vector<procedures::Sample> out, standing;
  const auto moveOn = [&] {
    if (!standing.empty()) out.push_back(medianOf(standing));
    standing.clear();
  };
  std::string last_reason = "there are no tag_detections";
  for (BagRecord record = bag.next(); record.kind != RecordKind::kEnd; record = bag.next()) {
    if (record.topic != RecordTopic::kDetections) {
      const auto pressures = messageOf<PressureArray>(record, path);
      const double time = pressures.header.stamp.toSec();
      const std::string& topic = topics[static_cast<std::size_t>(record.topic)];
      const Eigen::VectorXd values = pressuresOf(pressures, topic, scene.arm, path);
      record.topic == RecordTopic::kCommand ? watch.command(time, values)
                                            : watch.measured(time, values);
      continue;
    }
    const auto seen = messageOf<TagDetections>(record, path);
    const double time = seen.header.stamp.toSec();
    watch.seen(time, observationsOf(seen, scene));
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

void requireOpen(const basics::RegularFile& file, const std::string& path) {
  if (!file.isOpen()) throw io::DocumentError(path + " " + file.fault());
  if (file.size() > kMostBagBytes) {
    throw io::DocumentError(path + " " + basics::largerThan(kMostBagBytes) +
                            "; expected a shorter recording");
  }
}

}  // namespace

std::vector<procedures::TagObservation> observationsOf(const TagDetections& detections,
                                                       const io::Scene& scene) {
  std::map<int, procedures::TagObservation> found;
  for (const TagDetection& tag : detections.tags) {
    if (tag.repeated || !scene.tags || scene.tags->find(tag.id) < 0) continue;
    procedures::TagObservation& observation = found[tag.id];
    observation.id = tag.id;
    for (Eigen::Index k = 0; k < observation.corners.size(); ++k) {
      observation.corners(k) = tag.corners[static_cast<std::size_t>(k)];
    }
  }
  std::vector<procedures::TagObservation> out;
  for (const auto& [id, observation] : found) {
    if (observation.corners.allFinite()) out.push_back(observation);
  }
  return out;
}

std::vector<io::TagCornerCapture> numbered(const std::vector<procedures::Sample>& samples,
                                           const model::Arm& arm) {
  std::vector<io::TagCornerCapture> out;
  for (const procedures::Sample& sample : samples) {
    io::TagCornerCapture& capture = out.emplace_back();
    capture.number = static_cast<int>(out.size());
    capture.pressure = arm.clamped(sample.pressure);
    capture.time = sample.time;
    for (const procedures::TagObservation& tag : sample.tags) {
      capture.tags.push_back({tag.id, tag.corners});
    }
  }
  return out;
}

std::vector<procedures::Sample> loadBag(const std::string& path, const io::Scene& scene,
                                        const procedures::SettleRules& rules) {
  const basics::RegularFile file(path);
  requireOpen(file, path);
  return samplesOf(file, path, scene, rules);
}

procedures::CalibrationData loadMeasurements(const io::Scene& scene,
                                             const std::vector<std::string>& paths,
                                             const procedures::SettleRules& rules) {
  const std::string kRecording = ".bag";
  std::vector<std::string> tables, bags;
  for (const std::string& path : paths) {
    const bool is_bag =
        path.size() >= kRecording.size() &&
        path.compare(path.size() - kRecording.size(), kRecording.size(), kRecording) == 0;
    (is_bag ? bags : tables).push_back(path);
  }
  procedures::CalibrationData out = procedures::loadCalibrationData(scene, tables);
  for (const std::string& path : bags) {
    basics::RegularFile file(path);
    requireOpen(file, path);
    const std::string sha256 = io::sha256OfFile(file, path, kMostBagBytes);
    const auto seen = numbered(samplesOf(file, path, scene, rules), scene.arm);
    if (!file.isUnchanged()) {
      throw io::DocumentError(path +
                              " changed while it was read; expected one that is "
                              "closed");
    }
    procedures::LoadedCaptures loaded = procedures::makeCaptures(scene, seen, path);
    out.sources.push_back({path, sha256, static_cast<int>(loaded.captures.size())});
    procedures::addCaptures(std::move(loaded.captures), path, out);
  }
  return out;
}

}  // namespace helix_arm::ros_bridge
