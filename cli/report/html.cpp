#include "cli/report/html.h"

namespace lightstage::cli {

namespace {

constexpr const char* kStyle =
    "body{font:16px/1.5 system-ui,sans-serif;max-width:1100px;margin:2rem auto;padding:0 "
    "1rem;color:#222;background:#fafafa}"
    "h1{font-size:1.6rem}h2{font-size:1.2rem;margin-top:2rem}"
    "table{border-collapse:collapse;margin:1rem 0;background:#fff}"
    "th,td{padding:.35rem .9rem;border-bottom:1px solid #ddd;text-align:right;font-variant-numeric:tabular-nums}"
    "th:first-child,td:first-child{text-align:left}"
    "pre{background:#1e1e1e;color:#ddd;padding:1rem;overflow-x:auto;font-size:13px}"
    "figure{display:inline-block;margin:0 1rem 1rem 0;vertical-align:top;max-width:100%}"
    "figure img{max-width:100%;image-rendering:auto;background:#000}"
    "figcaption{font-size:.85rem;color:#555}";

}  // namespace

std::string html_escaped(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      default:
        escaped += c;
    }
  }
  return escaped;
}

HtmlPage::HtmlPage(const std::string& title) {
  html_ =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
      "<meta name=\"viewport\" content=\"width=device-width\"><title>" +
      html_escaped(title) + "</title><style>" + kStyle + "</style></head>\n<body>\n<h1>" + html_escaped(title) +
      "</h1>\n";
}

void HtmlPage::heading(const std::string& text) {
  html_ += "<h2>" + html_escaped(text) + "</h2>\n";
}

void HtmlPage::paragraph(const std::string& text) {
  html_ += "<p>" + html_escaped(text) + "</p>\n";
}

void HtmlPage::code(const std::string& text) {
  html_ += "<pre>" + html_escaped(text) + "</pre>\n";
}

void HtmlPage::table(const std::vector<std::vector<std::string>>& rows) {
  html_ += "<table>\n";
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const std::string cell = r == 0 ? "th" : "td";
    html_ += "<tr>";
    for (const std::string& text : rows[r]) html_ += "<" + cell + ">" + html_escaped(text) + "</" + cell + ">";
    html_ += "</tr>\n";
  }
  html_ += "</table>\n";
}

void HtmlPage::figures(const std::vector<Figure>& figures) {
  html_ += "<div>\n";
  for (const Figure& figure : figures) {
    const std::string source = html_escaped(figure.file.generic_string());
    html_ += "<figure><a href=\"" + source + "\"><img src=\"" + source + "\" alt=\"" + html_escaped(figure.caption) +
             "\"></a><figcaption>" + html_escaped(figure.caption) + "</figcaption></figure>\n";
  }
  html_ += "</div>\n";
}

std::string HtmlPage::finish() {
  return html_ + "</body></html>\n";
}

}  // namespace lightstage::cli
