#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>

#include <boost/array.hpp>
#include <ros/message_traits.h>
#include <ros/serialization.h>

namespace helix_arm::ros_bridge {

/// Reads a ROS message from bytes, without allocating more elements than these bytes can hold.
///
/// roscpp's own stream allocates whatever length an array claims before reading its elements: 32
/// bytes that claim 2^29 numbers cost 4 GB and 10 s. This one compares the claim with the bytes
/// left first. Every fault throws ros::serialization::StreamOverrunException.
class CheckedStream {
 public:
  static constexpr ros::serialization::StreamType stream_type =
      ros::serialization::stream_types::Input;

  /// @param data  `length` bytes, which outlive the stream.
  CheckedStream(const std::uint8_t* data, std::uint32_t length)
      : data_(const_cast<std::uint8_t*>(data)), left_(length) {}

  template <class T>
  void next(T& value) {
    ros::serialization::Serializer<T>::read(*this, value);
  }

  template <class T, class Allocator>
  void next(std::vector<T, Allocator>& values) {
    std::uint32_t count = 0;
    next(count);
    // The shortest element: empty strings and arrays consist of their counts.
    const std::uint64_t shortest = std::max(1U, ros::serialization::serializationLength(T()));
    if (count * shortest > left_) ros::serialization::throwStreamOverrun();
    values.resize(count);
    if constexpr (std::is_arithmetic_v<T>) {
      if (count > 0) std::memcpy(values.data(), advance(count * sizeof(T)), count * sizeof(T));
    } else {
      for (T& value : values) next(value);
    }
  }

  template <class T, std::size_t N>
  void next(boost::array<T, N>& values) {
    for (T& value : values) next(value);
  }

  /// The next bytes, for the serializers of roscpp.
  std::uint8_t* advance(std::uint64_t bytes) {
    if (bytes > left_) ros::serialization::throwStreamOverrun();
    std::uint8_t* const out = data_;
    data_ += bytes;
    left_ -= bytes;
    return out;
  }

  std::uint64_t left() const { return left_; }  ///< bytes

 private:
  std::uint8_t* data_;
  std::uint64_t left_;
};

}  // namespace helix_arm::ros_bridge
