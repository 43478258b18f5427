#pragma once

#include <string>
#include <utility>
#include <vector>

namespace helix_arm::ros_bridge {

/// Where services read and write by default: `helix_arm` below ROS_HOME, which is ~/.ros where it
/// is not set.
std::string defaultFolder();

/// How the comment of a data set of recorded samples begins.
inline constexpr char kRecordedTitle[] = "recorded of scene ";

/// Which files the services of a node read and write: those below some folders, since whoever
/// reaches the node may name any path. What a link points to counts, not where the link is.
class FileAccess {
 public:
  /// A folder, and the parameter that names it, such as "~out_folder".
  struct Folder {
    std::string path, parameter;
  };

  explicit FileAccess(std::vector<Folder> folders) : folders_(std::move(folders)) {}

  /// @param what     the file is called in messages: "data".
  /// @param given    an absolute path.
  /// @param endings  that it may have: ".csv".
  /// @return its path without links.
  /// @throws std::invalid_argument where it is no regular file with such an ending below the
  /// folders. Of a path elsewhere the message does not tell whether anything is there.
  std::string toRead(const std::string& what, const std::string& given,
                     const std::vector<std::string>& endings) const;

  /// The same for a file that is to be written: it may be there only where this package wrote it,
  /// as a calibrated scene (.yaml) or recorded samples (.csv), and its folder must be writable.
  std::string toWrite(const std::string& what, const std::string& given,
                      const std::vector<std::string>& endings) const;

 private:
  std::string resolved(const std::string& what, const std::string& given,
                       const std::vector<std::string>& endings) const;

  std::vector<Folder> folders_;
};

}  // namespace helix_arm::ros_bridge
