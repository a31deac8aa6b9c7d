// The demonstration's report: one page that opens anywhere, pictures beside it.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace lightstage::cli {

// Text as it must be written inside HTML.
std::string html_escaped(const std::string& text);

// A page built from the top down. Everything given is escaped.
class HtmlPage {
 public:
  explicit HtmlPage(const std::string& title);
  void heading(const std::string& text);
  void paragraph(const std::string& text);
  void code(const std::string& text);
  // The first row is the head.
  void table(const std::vector<std::vector<std::string>>& rows);
  struct Figure {
    std::filesystem::path file;  // relative to the page
    std::string caption;
  };
  void figures(const std::vector<Figure>& figures);
  std::string finish();

 private:
  std::string html_;
};

}  // namespace lightstage::cli
