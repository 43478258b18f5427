#pragma once

#include <string>
#include <vector>

#include <sys/types.h>

#include "bag_records.hpp"
#include "helix_arm/basics/regular_file.hpp"

namespace helix_arm::ros_bridge {

/// A record of a recording. Its bytes come from a process that read a file of unknown make.
struct BagRecord {
  RecordKind kind;
  RecordTopic topic;
  std::vector<std::uint8_t> bytes;
};

/// Has a rosbag read by bag_reader, a process of its own, which does not outlive the object.
/// Whatever the bag holds, this process goes on.
class BagProcess {
 public:
  /// @param path  of the file, for messages.
  /// @throws io::DocumentError where no process can be started.
  BagProcess(const basics::RegularFile& file, std::string path);
  ~BagProcess();
  BagProcess(const BagProcess&) = delete;
  BagProcess& operator=(const BagProcess&) = delete;

  /// The next record; kEnd is the last.
  /// @throws io::DocumentError naming the bag where reading it failed: it is damaged, and took the
  /// process down, more memory or time than it may.
  BagRecord next();

 private:
  void read(void* bytes, std::size_t size);
  [[noreturn]] void failed();
  [[noreturn]] void refuse(const std::string& fault) const;

  const std::string path_;
  pid_t process_ = -1;
  int pipe_ = -1;
};

}  // namespace helix_arm::ros_bridge
