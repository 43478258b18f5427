#pragma once

#include <optional>
#include <string>
#include <vector>

namespace helix_arm::io {

/// Folders of the package's YAML files, relative to the package.
inline constexpr char kShippedScenes[] = "config/scenes";
inline constexpr char kShippedRegulators[] = "config/regulators";

/// Path of a folder of the package: in the share folder if installed, otherwise in the sources.
std::string shippedFolder(const std::string& folder);

/// Names (without the extension) of the files in such a folder, sorted.
std::vector<std::string> shippedNames(const std::string& folder,
                                      const std::string& extension = ".yaml");

/// A text with a `/` or a `.` is a path; any other is the name of what the package ships.
bool isPath(const std::string& given);

/// The name of the shipped file that a path to no file seems to mean: demo of rigs/demo.yaml.
std::optional<std::string> shippedNameOf(const std::string& path, const std::string& folder,
                                         const std::string& extension = ".yaml");

/// The path of a scene that is given by its path or by the name of a shipped scene; nothing on a
/// name that is neither. A file that exists comes first. Nothing, too, where shippedNameOf() knows
/// what is meant.
std::optional<std::string> findScene(const std::string& given);
/// The fault of such a name, with the names of the shipped scenes.
std::string unknownScene(const std::string& given);
/// As findScene(). @throws std::invalid_argument with unknownScene().
std::string scenePath(const std::string& given);

}  // namespace helix_arm::io
