#include "shipped_files.hpp"

#include <algorithm>
#include <filesystem>

#include <dlfcn.h>

#include "basics/quote.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "io/document/map_reader.hpp"

namespace helix_arm::io {

namespace fs = std::filesystem;

std::string shippedFolder(const std::string& folder) {
  Dl_info library{};
  std::error_code error;
  if (dladdr(reinterpret_cast<const void*>(&shippedFolder), &library) != 0) {
    const fs::path here = fs::weakly_canonical(library.dli_fname, error).parent_path();
    // lib, or as Debian has it lib/<architecture>
    for (const char* prefix : {"..", "../.."}) {
      const fs::path installed = (here / prefix / "share/helix_arm" / folder).lexically_normal();
      if (fs::is_directory(installed, error)) return installed;
    }
  }
  return fs::path(HELIX_ARM_PACKAGE_DIR) / folder;
}

std::vector<std::string> shippedNames(const std::string& folder, const std::string& extension) {
  std::vector<std::string> names;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(shippedFolder(folder), error)) {
    if (entry.path().extension() == extension) names.push_back(entry.path().stem());
  }
  std::sort(names.begin(), names.end());
  return names;
}

bool isPath(const std::string& given) { return given.find_first_of("/.") != std::string::npos; }

std::optional<std::string> shippedNameOf(const std::string& path, const std::string& folder,
                                         const std::string& extension) {
  std::error_code error;
  const fs::path file(path);
  if (file.extension() != extension || fs::exists(file, error)) return std::nullopt;
  const std::vector<std::string> names = shippedNames(folder, extension);
  if (std::find(names.begin(), names.end(), file.stem()) == names.end()) return std::nullopt;
  return file.stem();
}

std::optional<std::string> findScene(const std::string& given) {
  std::error_code error;
  if (shippedNameOf(given, kShippedScenes)) return std::nullopt;
  if (given.empty() || isPath(given) || fs::is_regular_file(given, error)) return given;
  const std::vector<std::string> shipped = shippedNames(kShippedScenes);
  if (std::find(shipped.begin(), shipped.end(), given) == shipped.end()) return std::nullopt;
  return fs::path(shippedFolder(kShippedScenes)) / (given + ".yaml");
}

std::string unknownScene(const std::string& given) {
  if (const auto name = shippedNameOf(given, kShippedScenes)) {
    return "there is no file " + basics::quoted(given) + "; the shipped scene is called " + *name;
  }
  return "the scene " + basics::quoted(given) +
         " is neither a file nor a shipped scene; expected the path of a scene file, or " +
         alternatives(shippedNames(kShippedScenes));
}

std::string scenePath(const std::string& given) {
  const std::optional<std::string> path = findScene(given);
  basics::require(path.has_value(), unknownScene(given));
  return *path;
}

}  // namespace helix_arm::io
