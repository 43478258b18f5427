#include "pdf.hpp"

#include <algorithm>
#include <memory>
#include <stdexcept>

#include <cairo/cairo-pdf.h>

namespace helix_arm::cli {
namespace {

using procedures::Align;
using procedures::Area;
using procedures::Box;
using procedures::Label;
using procedures::Page;
using procedures::PrintedTag;
using procedures::Stroke;

constexpr double kPointsPerMillimetre = 72 / 25.4;
constexpr double kDash = 1.0;  // [mm]

using Surface = std::unique_ptr<cairo_surface_t, void (*)(cairo_surface_t*)>;
using Context = std::unique_ptr<cairo_t, void (*)(cairo_t*)>;

cairo_status_t append(void* bytes, const unsigned char* data, unsigned int size) {
  static_cast<std::string*>(bytes)->append(reinterpret_cast<const char*>(data), size);
  return CAIRO_STATUS_SUCCESS;
}

void check(cairo_status_t status) {
  if (status == CAIRO_STATUS_SUCCESS) return;
  throw std::runtime_error(std::string("the PDF cannot be created: ") +
                           cairo_status_to_string(status));
}

void draw(const PrintedTag& tag, cairo_t* to) {
  // Drawn as one area, since viewers show seams between adjacent ones.
  for (const Box& box : tag.black) cairo_rectangle(to, box.x, box.y, box.width, box.height);
  cairo_fill(to);
}

void draw(const Stroke& stroke, cairo_t* to) {
  cairo_set_source_rgb(to, stroke.gray, stroke.gray, stroke.gray);
  cairo_set_line_width(to, stroke.width);
  cairo_set_dash(to, &kDash, stroke.dashed ? 1 : 0, 0);
  cairo_move_to(to, stroke.from.x, stroke.from.y);
  cairo_line_to(to, stroke.to.x, stroke.to.y);
  cairo_stroke(to);
}

void draw(const Area& area, cairo_t* to) {
  cairo_set_source_rgb(to, area.gray, area.gray, area.gray);
  for (const procedures::Point& corner : area.corners) cairo_line_to(to, corner.x, corner.y);
  cairo_close_path(to);
  cairo_fill(to);
}

void draw(const Label& label, cairo_t* to) {
  // Font size and baseline, as fractions of the line height.
  constexpr double kFontSize = 0.84, kBaseline = 0.79;
  const Box& box = label.box;
  cairo_select_font_face(to, "sans-serif", CAIRO_FONT_SLANT_NORMAL,
                         label.bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
  cairo_text_extents_t extents;
  double size = kFontSize * box.height;
  cairo_set_font_size(to, size);
  cairo_text_extents(to, label.text.c_str(), &extents);
  if (extents.x_advance > box.width) {
    size *= box.width / extents.x_advance;
    cairo_set_font_size(to, size);
    cairo_text_extents(to, label.text.c_str(), &extents);
  }
  const double spare = box.width - extents.x_advance;
  const double shift = label.align == Align::kLeft     ? 0
                       : label.align == Align::kCentre ? 0.5 * spare
                                                       : spare;
  // Reduced text is centred vertically in its line.
  const double lift = (kBaseline / kFontSize - 0.5 / kFontSize) * (kFontSize * box.height - size);
  cairo_move_to(to, box.x + shift, box.y + kBaseline * box.height - lift);
  cairo_show_text(to, label.text.c_str());
}

void draw(const Page& page, cairo_t* to) {
  for (const Stroke& stroke : page.strokes) draw(stroke, to);
  for (const Area& area : page.areas) draw(area, to);
  cairo_set_source_rgb(to, 0, 0, 0);
  for (const PrintedTag& tag : page.tags) draw(tag, to);
  for (const Label& label : page.labels) draw(label, to);
  cairo_show_page(to);
}

}  // namespace

std::string pdfOf(const std::vector<Page>& pages, const procedures::Paper& paper,
                  const std::string& title) {
  std::string bytes;
  const Surface surface(
      cairo_pdf_surface_create_for_stream(append, &bytes, kPointsPerMillimetre * paper.width,
                                          kPointsPerMillimetre * paper.height),
      cairo_surface_destroy);
  cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_TITLE, title.c_str());
  const Context to(cairo_create(surface.get()), cairo_destroy);
  cairo_scale(to.get(), kPointsPerMillimetre, kPointsPerMillimetre);
  // Text metrics of paper, not of a screen.
  const std::unique_ptr<cairo_font_options_t, void (*)(cairo_font_options_t*)> options(
      cairo_font_options_create(), cairo_font_options_destroy);
  cairo_font_options_set_hint_style(options.get(), CAIRO_HINT_STYLE_NONE);
  cairo_font_options_set_hint_metrics(options.get(), CAIRO_HINT_METRICS_OFF);
  cairo_set_font_options(to.get(), options.get());
  for (const Page& page : pages) draw(page, to.get());
  check(cairo_status(to.get()));
  cairo_surface_finish(surface.get());
  check(cairo_surface_status(surface.get()));
  return bytes;
}

}  // namespace helix_arm::cli
