// Reads the rosbag on stdin, a regular file, and writes on stdout what a calibration needs of it.
// rosbag trusts the content of a bag, so a damaged bag may end the process that reads it. It is
// therefore read here, in a separate process with limits of memory and time.
#include <algorithm>
#include <cerrno>
#include <exception>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sys/resource.h>
#include <unistd.h>

#include "bag_records.hpp"

namespace helix_arm::ros_bridge {
namespace {

void bound(__rlimit_resource what, rlim_t most, rlim_t never) {
  const rlimit limit{most, never};
  setrlimit(what, &limit);
}

// Exits if the reader of stdout has ended.
void write(const void* data, std::size_t size) {
  const char* bytes = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t count = ::write(STDOUT_FILENO, bytes, size);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) _exit(1);
    bytes += count;
    size -= static_cast<std::size_t>(count);
  }
}

void write(RecordKind kind, RecordTopic topic = {}, const void* bytes = nullptr,
           std::size_t size = 0) {
  if (size > kMostRecordBytes) throw rosbag::BagFormatException("a message is too large");
  RecordHead head{};
  head.kind = kind;
  head.topic = topic;
  head.bytes = static_cast<std::uint32_t>(size);
  write(&head, sizeof head);
  write(bytes, size);
}

std::optional<RecordTopic> topicOf(const std::string& name, const std::string& type) {
  for (int i = 0; i < kRecordTopics; ++i) {
    const auto topic = static_cast<RecordTopic>(i);
    const TopicRule rule = ruleOf(topic);
    if (name.substr(name.rfind('/') + 1) == rule.name && type == rule.type) return topic;
  }
  return std::nullopt;
}

// Serialised again: lengths in a damaged message are not passed on.
template <class Message>
void writeMessage(RecordTopic topic, const Message& message, std::vector<std::uint8_t>& buffer) {
  buffer.resize(ros::serialization::serializationLength(message));
  ros::serialization::OStream stream(buffer.data(), static_cast<std::uint32_t>(buffer.size()));
  ros::serialization::serialize(stream, message);
  write(RecordKind::kMessage, topic, buffer.data(), buffer.size());
}

void read() {
  rosbag::Bag bag("/proc/self/fd/0", rosbag::bagmode::Read);
  std::set<std::string> topics;
  rosbag::View all(bag);
  for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
    const std::string& name = connection->topic;
    const auto topic = topicOf(name, connection->datatype);
    if (topic && topics.insert(name).second) {
      write(RecordKind::kTopic, *topic, name.data(), name.size());
    }
  }
  write(RecordKind::kTopicsEnd);
  const std::vector<std::string> wanted(topics.begin(), topics.end());
  rosbag::View view(bag, rosbag::TopicQuery(wanted));
  std::vector<std::uint8_t> buffer;
  for (const rosbag::MessageInstance& instance : view) {
    const auto topic = topicOf(instance.getTopic(), instance.getDataType());
    if (!topic) continue;
    if (const auto pressures = instance.instantiate<PressureArray>()) {
      writeMessage(*topic, *pressures, buffer);
    } else if (const auto seen = instance.instantiate<TagDetections>()) {
      writeMessage(*topic, *seen, buffer);
    }
  }
  write(RecordKind::kEnd);
}

}  // namespace
}  // namespace helix_arm::ros_bridge

int main() {
  using namespace helix_arm::ros_bridge;
  bound(RLIMIT_CORE, 0, 0);
  bound(RLIMIT_AS, kMostReaderMemory, kMostReaderMemory);
  bound(RLIMIT_CPU, kMostReaderTime,
        kMostReaderTime + 1);  // the first limit raises SIGXCPU, which is reported
  try {
    read();
    return 0;
  } catch (const std::exception& fault) {
    const std::string text = fault.what();
    write(RecordKind::kFault, {}, text.data(), std::min<std::size_t>(text.size(), 1000));
    return 1;
  }
}
