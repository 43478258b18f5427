#pragma once

#include <cstdint>

#include "helix_arm/PressureArray.h"
#include "helix_arm/TagDetections.h"
#include "ros_bridge/names.hpp"

/// What bag_reader, a process of its own, writes of a recording on its stdout, and loadBag() reads:
/// one record after another, each a RecordHead and its bytes.
namespace helix_arm::ros_bridge {

enum class RecordKind : std::uint8_t {
  kTopic = 'T',  ///< the name of a topic; all of them come first
  kTopicsEnd = 't',
  kMessage = 'M',  ///< serialized as roscpp does, in the order of the recording
  kFault = 'F',    ///< why the recording cannot be read, or no further
  kEnd = 'E',      ///< all was read
};

/// What a topic is, by its name behind the last `/` and its type.
enum class RecordTopic : std::uint8_t { kDetections, kMeasured, kCommand };
inline constexpr int kRecordTopics = 3;

struct TopicRule {
  const char* name;
  const char* type;
};
inline TopicRule ruleOf(RecordTopic topic) {
  using ros::message_traits::datatype;
  switch (topic) {
    case RecordTopic::kDetections:
      return {names::kTagDetections, datatype<TagDetections>()};
    case RecordTopic::kMeasured:
      return {names::kPressureMeasured, datatype<PressureArray>()};
    case RecordTopic::kCommand:
      break;
  }
  return {names::kPressureCommand, datatype<PressureArray>()};
}

struct RecordHead {
  RecordKind kind;
  RecordTopic topic;    ///< kTopic and kMessage
  std::uint32_t bytes;  ///< that follow; kMostRecordBytes at most
};
inline constexpr std::uint32_t kMostRecordBytes = 1U << 20U;

// What it may take [bytes, s of processor time]: a recording says itself how much memory it wants.
inline constexpr std::uint64_t kMostReaderMemory = 1ULL << 30U;
inline constexpr int kMostReaderTime = 120;

}  // namespace helix_arm::ros_bridge
