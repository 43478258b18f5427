#pragma once

#include <string>
#include <vector>

#include "helix_arm/procedures/printed_page.hpp"

namespace helix_arm::cli {

/// The bytes of a PDF with these pages. Everything in it is drawn by lines and areas, exact to
/// 2 um, and its fonts are embedded.
/// @param title  of the document, as viewers show it.
/// @throws std::runtime_error if the PDF library fails.
std::string pdfOf(const std::vector<procedures::Page>& pages, const procedures::Paper& paper,
                  const std::string& title);

}  // namespace helix_arm::cli
