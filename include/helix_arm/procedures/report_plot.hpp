#pragma once

#include <filesystem>
#include <string>

namespace helix_arm::procedures {

/// Has plot_report draw a report, a JSON document, as a picture.
///
/// @param report  its file.
/// @param without  what the user may do to go without the picture: "leave it out with --no-files".
/// @throws io::FileError naming the picture and the remedy.
void drawReport(const std::filesystem::path& report, const std::filesystem::path& picture,
                const std::string& without);
/// A file that a report names, in its folder.
struct ReportPart {
  std::string name, content;
};
/// The same of a report that is in no file. @param beside  without a name: none.
/// @return what plot_report printed.
/// @throws also std::invalid_argument saying why the report cannot be drawn on its paper.
std::string drawReportText(const std::string& report, const std::filesystem::path& picture,
                           const std::string& without, const ReportPart& beside = {});

}  // namespace helix_arm::procedures
