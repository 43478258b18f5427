// What no message does: throw into roscpp, or make room for what it does not hold.
#include "ros_bridge/common/guarded_callbacks.hpp"

#include <filesystem>
#include <limits>
#include <regex>

#include <gtest/gtest.h>

#include "helix_arm/Calibrate.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/TagDetections.h"
#include "support/temporary_file.hpp"

namespace helix_arm::ros_bridge {
namespace {

using ros::serialization::StreamOverrunException;

template <class Message>
std::string bytesOf(const Message& message) {
  std::string out(ros::serialization::serializationLength(message), '\0');
  ros::serialization::OStream stream(reinterpret_cast<std::uint8_t*>(out.data()),
                                     static_cast<std::uint32_t>(out.size()));
  ros::serialization::serialize(stream, message);
  return out;
}

template <class Message>
Message read(const std::string& bytes) {
  Message out;
  CheckedStream stream(reinterpret_cast<const std::uint8_t*>(bytes.data()),
                       static_cast<std::uint32_t>(bytes.size()));
  stream.next(out);
  EXPECT_EQ(stream.left(), 0U);
  return out;
}

PressureArray pressures() {
  PressureArray out;
  out.header.seq = 7;
  out.header.stamp = ros::Time(12, 34);
  out.header.frame_id = "base";
  out.name = {"a", "", "muscle_3"};
  out.pressure = {1e5, std::numeric_limits<double>::infinity(), -0.0};
  return out;
}

TagDetections detections() {
  TagDetections out;
  for (int id : {3, 5}) {
    TagDetection tag;
    tag.id = id;
    tag.corners.fill(0.5 * id);
    tag.known = true;
    out.tags.push_back(tag);
  }
  return out;
}

// Serialised again, what was read is what was written.
TEST(CheckedStream, ReadsWhatRoscppWrites) {
  for (const std::string& bytes : {bytesOf(pressures()), bytesOf(PressureArray())}) {
    EXPECT_EQ(bytesOf(read<PressureArray>(bytes)), bytes);
  }
  for (const std::string& bytes : {bytesOf(detections()), bytesOf(TagDetections())}) {
    EXPECT_EQ(bytesOf(read<TagDetections>(bytes)), bytes);
  }
  EXPECT_EQ(read<PressureArray>(bytesOf(pressures())).name, pressures().name);
}

// 32 bytes and a claim: 2^29 numbers were 4 GB, as many names 17 GB.
TEST(CheckedStream, AnArrayLongerThanItsMessageAllocatesNothing) {
  for (const std::uint32_t claim : {4U, 1U << 29U, 0xffffffffU}) {
    // The lengths of the names, behind the header, and of the numbers at the end.
    for (const int field : {20, -28}) {
      std::string bytes = bytesOf(pressures());
      const auto place = static_cast<std::size_t>(field < 0 ? field + int(bytes.size()) : field);
      ASSERT_EQ(bytes.substr(place, 4), std::string("\3\0\0\0", 4));
      std::memcpy(&bytes[place], &claim, sizeof claim);
      PressureArray out;
      CheckedStream stream(reinterpret_cast<const std::uint8_t*>(bytes.data()),
                           static_cast<std::uint32_t>(bytes.size()));
      EXPECT_THROW(stream.next(out), StreamOverrunException) << field << " " << claim;
      EXPECT_LE(out.name.capacity(), bytes.size());
      EXPECT_LE(out.pressure.capacity(), bytes.size());
    }
  }
}

TEST(CheckedStream, EveryMessageThatEndsTooEarlyIsRefused) {
  const std::string bytes = bytesOf(detections());
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    TagDetections out;
    CheckedStream stream(reinterpret_cast<const std::uint8_t*>(bytes.data()),
                         static_cast<std::uint32_t>(length));
    EXPECT_THROW(stream.next(out), StreamOverrunException) << length;
  }
}

TEST(FaultGuard, CatchesAnyExceptionAndReportsTheCulpritOnce) {
  std::vector<std::string> lines;
  FaultGuard guard("a message on /t", [&](const std::string& line) { lines.push_back(line); });
  std::string why;
  EXPECT_TRUE(guard.run(
      "/n", [] {}, &why));
  EXPECT_TRUE(lines.empty());
  EXPECT_FALSE(guard.run(
      "/n", [] { throw std::runtime_error("out of range"); }, &why));
  EXPECT_EQ(why, "out of range");
  EXPECT_FALSE(guard.run("/n", [] { throw 3; }));
  EXPECT_FALSE(guard.run("/n", [] { throw std::bad_alloc(); }));
  ASSERT_EQ(lines.size(), 1U);  // the others came within the period of the warnings
  EXPECT_EQ(lines[0], "a message on /t from /n was dropped (1 so far): out of range");
}

// A service that throws answers with the reason.
// roscpp asks twice for an empty message where a node has two subscriptions of a topic, as actions
// have: the second time with the buffer that it freed, and what is there now, for a message.
TEST(GuardedSubscription, AnEmptyMessageIsNotReadFromItsFreedBuffer) {
  std::string freed = bytesOf(pressures());
  GuardedSubscription<PressureArray> subscription("pressure", [](const auto&) {});
  ros::SubscriptionCallbackHelperDeserializeParams params;
  params.buffer = reinterpret_cast<std::uint8_t*>(freed.data());
  params.length = static_cast<std::uint32_t>(freed.size());
  EXPECT_NE(subscription.deserialize(params), nullptr);
  params.length = 0;
  EXPECT_EQ(subscription.deserialize(params), nullptr);
  params.length = static_cast<std::uint32_t>(0 - reinterpret_cast<std::uintptr_t>(params.buffer));
  EXPECT_EQ(subscription.deserialize(params), nullptr);
}

TEST(GuardedService, WhatItThrowsIsTheAnswer) {
  GuardedService<Calibrate::Request, Calibrate::Response> service(
      "/s",
      [](const std::string&, Calibrate::Request&, Calibrate::Response&) -> bool {
        throw std::runtime_error("so it is");
      },
      [](const std::string&) {});
  ros::ServiceCallbackHelperCallParams params;
  params.request = ros::serialization::serializeMessage(Calibrate::Request());
  EXPECT_TRUE(service.call(params));  // else roscpp sends an empty answer of its own
  const std::string answer(reinterpret_cast<const char*>(params.response.buf.get()),
                           params.response.num_bytes);
  EXPECT_EQ(answer[0], '\0');
  EXPECT_NE(answer.find("so it is"), std::string::npos);
}

// Searches the sources of all nodes but one.
void expectNowhereBut(const char* exception, const std::string& pattern, const char* remedy) {
  const std::regex raw(pattern);
  int files = 0;
  for (const char* folder : {"/src/ros_bridge", "/src/nodes"}) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(
             std::string(HELIX_ARM_SOURCE_DIR) + folder)) {
      if (!entry.is_regular_file() || entry.path().filename() == exception) continue;
      EXPECT_FALSE(std::regex_search(test::contentOf(entry.path()), raw))
          << entry.path() << ": " << remedy;
      ++files;
    }
  }
  EXPECT_GT(files, 30);
}

TEST(GuardedCallbacks, NoNodeBypassesThem) {
  expectNowhereBut("guarded_callbacks.hpp", R"((subscribe|advertiseService|create\w*Timer)\s*[<(])",
                   "makes a callback by itself; see guarded_callbacks.hpp");
}

// rosconsole would block the thread that logs while the terminal is held up.
TEST(Log, NoNodeBypassesIt) {
  expectNowhereBut("diagnostics.cpp", R"(\bROS_(DEBUG|INFO|WARN|ERROR|FATAL|LOG)\w*\s*\()",
                   "logs in its own thread; see diagnostics.hpp");
}

}  // namespace
}  // namespace helix_arm::ros_bridge
