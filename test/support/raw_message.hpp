#pragma once

#include <cstdint>
#include <cstring>
#include <string>

#include <ros/message_traits.h>
#include <ros/serialization.h>

namespace helix_arm::test {

/// A message of any type, as the bytes on the wire.
struct RawMessage {
  std::string bytes;
};

}  // namespace helix_arm::test

namespace ros {
namespace message_traits {

template <>
struct MD5Sum<helix_arm::test::RawMessage> {
  static const char* value(const helix_arm::test::RawMessage&) { return value(); }
  static const char* value() { return "*"; }
};
template <>
struct DataType<helix_arm::test::RawMessage> {
  static const char* value(const helix_arm::test::RawMessage&) { return value(); }
  static const char* value() { return "*"; }
};
template <>
struct Definition<helix_arm::test::RawMessage> {
  static const char* value(const helix_arm::test::RawMessage&) { return value(); }
  static const char* value() { return ""; }
};

}  // namespace message_traits

namespace serialization {

template <>
struct Serializer<helix_arm::test::RawMessage> {
  template <class Stream>
  static void write(Stream& stream, const helix_arm::test::RawMessage& message) {
    const auto length = static_cast<std::uint32_t>(message.bytes.size());
    if (length > 0) std::memcpy(stream.advance(length), message.bytes.data(), length);
  }
  template <class Stream>
  static void read(Stream& stream, helix_arm::test::RawMessage& message) {
    const std::uint32_t length = stream.getLength();
    message.bytes.assign(reinterpret_cast<const char*>(stream.advance(length)), length);
  }
  static std::uint32_t serializedLength(const helix_arm::test::RawMessage& message) {
    return static_cast<std::uint32_t>(message.bytes.size());
  }
};

}  // namespace serialization
}  // namespace ros
