#include "db/store/log_damage.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "core/big_endian.h"
#include "core/error.h"
#include "core/file.h"
#include "core/file_descriptor.h"
#include "core/interrupt.h"
#include "core/text.h"
#include "db/store/bare_file.h"
#include "db/store/catalogue.h"

namespace lightstage::db {

namespace fs = std::filesystem;

namespace {

using Bytes = std::span<const unsigned char>;
using core::big_endian_32;

// Section 4.1 of the file format: eight big-endian words, the last two of which are the checksum of the others. Pages follow, each behind six words: its number, after a
// transaction's last page the size of the database (else 0), both salts of the header, and the checksum of everything so far.
constexpr std::size_t kHeader = 32, kPageHeader = 24;
constexpr std::uint32_t kMagic = 0x377f0682;  // one more where sums go over big-endian words
constexpr std::uint32_t kVersion = 3007000;

// Section 4.2.
struct Sum {
  std::uint32_t s1 = 0, s2 = 0;
  bool operator==(const Sum&) const = default;

  void add(std::uint32_t x1, std::uint32_t x2) {
    s1 += x1 + s2;
    s2 += x2 + s1;
  }
  void add(Bytes bytes, bool big_endian) {
    for (std::size_t i = 0; i + 8 <= bytes.size(); i += 8) {
      const std::uint32_t x1 = big_endian_32(bytes, i), x2 = big_endian_32(bytes, i + 4);
      big_endian ? add(x1, x2) : add(__builtin_bswap32(x1), __builtin_bswap32(x2));
    }
  }
};

Sum sum_at(Bytes bytes, std::size_t at) {
  return {big_endian_32(bytes, at), big_endian_32(bytes, at + 4)};
}

struct Bit {
  std::size_t offset = 0;
  unsigned char mask = 0;
};

// Which bit of the bytes is wrong, when the sum over them came to `is` and should have come to `wanted`. A change d of the first word of a pair adds
// (d, d) to the sum, of the second (0, d), and every pair after it takes (a, b) to (a + b, a + 2 b). One bit for most changes; of the eight highest bits of a word
// each has the same effect in every 3, 6, 12, ... pairs, so that there are several.
std::vector<Bit> wrong_bits(Bytes bytes, const Sum& is, const Sum& wanted, bool big_endian) {
  const Sum missing{wanted.s1 - is.s1, wanted.s2 - is.s2};
  std::vector<Bit> found;
  std::array<Sum, 2> effect{Sum{1, 1}, Sum{0, 1}};
  for (std::size_t pair = bytes.size() / 8; pair-- > 0;) {
    for (std::size_t which = 0; which < 2; ++which) {
      const std::size_t at = pair * 8 + which * 4;
      for (int bit = 0; bit < 32; ++bit) {
        const std::size_t byte = at + std::size_t(big_endian ? 3 - bit / 8 : bit / 8);
        const auto mask = static_cast<unsigned char>(1 << bit % 8);
        std::uint32_t change = std::uint32_t(1) << bit;
        if ((bytes[byte] & mask) != 0) change = 0 - change;
        if (effect[which].s1 * change == missing.s1 && effect[which].s2 * change == missing.s2)
          found.push_back({byte, mask});
      }
      effect[which] = {effect[which].s1 + effect[which].s2, effect[which].s1 + 2 * effect[which].s2};
    }
  }
  return found;
}

struct Damage {
  std::size_t page = 0;      // the first whose checksum fails, from 1; 0: the header
  std::size_t keep = 0;      // bytes of the file up to the last transaction before it
  std::size_t lost = 0;      // pages from there to the end of the last transaction behind it
  bool flipped = false;      // one wrong bit explains it
  std::optional<Bit> wrong;  // which, where that is known or does not matter
};

class Log {
 public:
  explicit Log(const fs::path& store_folder) : folder_(store_folder), file_(log_path(store_folder)) {}

  std::optional<Damage> look() {
    std::array<unsigned char, kHeader> header{};
    if (file_.read(0, header) < kHeader) return std::nullopt;
    if (!take_header(header)) return damaged_header(header);
    Sum sum = sum_at(header, 24);
    std::size_t committed = 0;
    for (std::size_t number = 1;; ++number) {
      if (!read(number)) return std::nullopt;
      if (!follows(sum)) return behind(number, committed, sum);
      sum = sum_at(page_, 16);
      if (big_endian_32(page_, 4) != 0) committed = number;
    }
  }

 private:
  bool take_header(Bytes header) {
    big_endian_ = (header[3] & 1) != 0;
    const std::uint32_t size = big_endian_32(header, 8);
    Sum sum;
    sum.add(header.first(24), big_endian_);
    if ((big_endian_32(header, 0) & ~1u) != kMagic || big_endian_32(header, 4) != kVersion || size < 512 ||
        size > 65536 || !std::has_single_bit(size) || sum != sum_at(header, 24))
      return false;
    salts_ = sum_at(header, 16);
    page_.resize(kPageHeader + size);
    return true;
  }

  std::size_t offset(std::size_t number) const { return kHeader + (number - 1) * page_.size(); }
  bool read(std::size_t number) {
    if (number % 1024 == 0) core::throw_if_interrupted();
    return file_.read(offset(number), page_) == page_.size();
  }

  Sum sum_after(const Sum& before) const {
    Sum sum = before;
    sum.add(Bytes(page_).first(8), big_endian_);
    sum.add(Bytes(page_).subspan(kPageHeader), big_endian_);
    return sum;
  }
  bool has_salts() const { return sum_at(page_, 8) == salts_ && big_endian_32(page_, 0) != 0; }
  bool follows(const Sum& before) const { return has_salts() && sum_after(before) == sum_at(page_, 16); }

  // A header is written and synced before the pages behind it: it is never torn, and what cannot be read of it was there.
  std::optional<Damage> damaged_header(std::array<unsigned char, kHeader> header) {
    std::optional<Bit> wrong;
    for (std::size_t i = 0; i < 8 * kHeader; ++i) {
      const Bit bit{i / 8, static_cast<unsigned char>(1 << i % 8)};
      header[bit.offset] ^= bit.mask;
      const bool sound = take_header(header);
      header[bit.offset] ^= bit.mask;
      if (!sound) continue;
      wrong = bit;
      // The last salt could be wrong as well as the checksum: the pages have the right one.
      if (read(1) && has_salts()) break;
    }
    if (wrong) return Damage{0, 0, 0, true, wrong};
    // The catalogue says how large pages are, the first page which salts they have.
    std::array<unsigned char, 18> start{};
    BareFile(catalogue_path(folder_)).read(0, start);
    const std::size_t said = std::size_t(start[16]) << 8 | start[17], size = said == 1 ? 65536 : said;
    if (size < 512 || !std::has_single_bit(size)) return std::nullopt;
    page_.resize(kPageHeader + size);
    if (!read(1)) return std::nullopt;
    salts_ = sum_at(page_, 8);
    for (const bool big_endian : {false, true}) {
      big_endian_ = big_endian;
      const std::size_t last = last_page_of_others(1, 1);
      if (last > 0) return Damage{0, 0, last, false, std::nullopt};
    }
    return std::nullopt;
  }

  // What follows the last sound page.
  std::optional<Damage> behind(std::size_t number, std::size_t committed, const Sum& before) {
    Damage damage{number, offset(committed + 1), 0, false, std::nullopt};
    explain(damage, before);
    if (!read(number)) return std::nullopt;
    const bool ends_transaction = has_salts() && big_endian_32(page_, 4) != 0;
    const std::size_t last = last_page_of_others(number, damage.flipped || ends_transaction ? 1 : 2);
    if (last == 0 && !damage.flipped) return std::nullopt;
    damage.lost = std::max(last, number) - committed;
    return damage;
  }

  // Whether one bit of the page that was read last, which should follow this sum, is wrong, and which.
  void explain(Damage& damage, const Sum& before) {
    const auto at = [&](std::size_t byte, unsigned char mask) { return Bit{offset(damage.page) + byte, mask}; };
    const auto differing = [&](std::size_t byte, const Sum& is, const Sum& should) -> std::optional<Bit> {
      const std::uint64_t bits = std::uint64_t(is.s1 ^ should.s1) << 32 | (is.s2 ^ should.s2);
      if (std::popcount(bits) != 1) return std::nullopt;
      const auto bit = std::size_t(std::countl_zero(bits));
      return at(byte + bit / 8, static_cast<unsigned char>(0x80 >> bit % 8));
    };
    const Sum salts = sum_at(page_, 8), said = sum_at(page_, 16), is = sum_after(before);
    if (salts != salts_) {
      if (is == said) damage.wrong = differing(8, salts, salts_);
      damage.flipped = damage.wrong.has_value();
      return;
    }
    std::vector<unsigned char> summed(page_.begin(), page_.begin() + 8);
    summed.insert(summed.end(), page_.begin() + kPageHeader, page_.end());
    const std::vector<Bit> in_page = wrong_bits(summed, is, said, big_endian_);
    const std::optional<Bit> in_sum = differing(16, said, is);
    damage.flipped = in_sum || !in_page.empty();
    if (!damage.flipped) return;
    // The next page goes by this one's sum as it should be.
    const std::uint32_t number = big_endian_32(page_, 0);
    const bool sum_is_wrong = in_sum && (in_page.empty() || (read(damage.page + 1) && follows(is)));
    if (sum_is_wrong) {
      damage.wrong = in_sum;
      return;
    }
    // Which of several it is does not matter where a later transaction has written the page again.
    const bool its_number = std::any_of(in_page.begin(), in_page.end(), [](const Bit& bit) { return bit.offset < 8; });
    const bool known = in_page.size() == 1 && !in_sum;
    if (!known && (its_number || !is_written_again(damage.page, number, said))) return;
    const Bit& bit = in_page.front();
    damage.wrong = at(bit.offset < 8 ? bit.offset : kPageHeader + bit.offset - 8, bit.mask);
  }

  // Whether a whole transaction in the run that follows this page holds this page of the database again.
  bool is_written_again(std::size_t page, std::uint32_t number, Sum before) {
    bool again = false;
    for (std::size_t next = page + 1; read(next) && follows(before); ++next) {
      again = again || big_endian_32(page_, 0) == number;
      if (again && big_endian_32(page_, 4) != 0) return true;
      before = sum_at(page_, 16);
    }
    return false;
  }

  // The last page of the last whole transaction behind this page. Pages that follow each other must end so many of them, where they follow this one, and two where they do
  // not: one may be left of a transaction that a crash tore, and of which later ones have overwritten the beginning. 0: none.
  std::size_t last_page_of_others(std::size_t number, int transactions) {
    std::size_t last = 0;
    int in_run = 0;
    if (!read(number)) return 0;
    Sum before = sum_at(page_, 16);
    for (std::size_t next = number + 1; read(next); ++next) {
      if (!follows(before)) {
        in_run = 0;
        transactions = 2;
      } else if (big_endian_32(page_, 4) != 0 && ++in_run >= transactions) {
        last = next;
      }
      before = sum_at(page_, 16);
    }
    return last;
  }

  fs::path folder_;
  BareFile file_;
  bool big_endian_ = false;
  Sum salts_;
  std::vector<unsigned char> page_;  // that was read last, with what stands before it
};

bool is_there(const fs::path& store_folder) {
  std::error_code none;
  return fs::is_regular_file(fs::symlink_status(log_path(store_folder), none)) &&
         fs::is_regular_file(fs::symlink_status(catalogue_path(store_folder), none));
}

std::string place(const Damage& damage) {
  return damage.page == 0 ? "in its header" : "at page " + std::to_string(damage.page);
}

// A descriptor of the log that is written to. Nobody else has it open.
class Writer {
 public:
  explicit Writer(const fs::path& path) : path_(path), file_(::open(path.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW)) {
    must(file_.is_open());
  }

  void flip(const Bit& bit) {
    unsigned char byte = 0;
    must(::pread(file_.get(), &byte, 1, off_t(bit.offset)) == 1);
    byte = static_cast<unsigned char>(byte ^ bit.mask);
    must(::pwrite(file_.get(), &byte, 1, off_t(bit.offset)) == 1);
    must(::fsync(file_.get()) == 0);
  }
  void cut(std::size_t bytes) {
    must(::ftruncate(file_.get(), off_t(bytes)) == 0);
    must(::fsync(file_.get()) == 0);
  }

 private:
  void must(bool done) const {
    if (!done) throw core::StoreError(path_.string() + ": cannot be mended: " + std::generic_category().message(errno));
  }
  fs::path path_;
  core::FileDescriptor file_;
};

// While others write, a page may be there only in part, or the log be begun anew.
std::optional<Damage> lasting_damage(const fs::path& store_folder) {
  if (!is_there(store_folder)) return std::nullopt;
  std::optional<Damage> damage = Log(store_folder).look();
  if (damage) {
    const NobodyElse alone(catalogue_path(store_folder));
    if (alone) return Log(store_folder).look();
  }
  for (int i = 1; damage && i < kLooks; ++i) {
    std::this_thread::sleep_for(kBetweenLooks);
    damage = Log(store_folder).look();
  }
  return damage;
}

fs::path keep_copy(const fs::path& log) {
  fs::path copy = numbered(log, kDamagedSuffix);
  core::replace_file_atomically(copy, [&](const fs::path& temporary) {
    std::error_code error;
    fs::copy_file(log, temporary, fs::copy_options::overwrite_existing, error);
    if (error) throw core::StoreError(copy.string() + ": cannot be made: " + error.message());
  });
  return copy;
}

}  // namespace

fs::path log_path(const fs::path& store_folder) {
  return catalogue_path(store_folder).string() + "-wal";
}

void refuse_damaged_log(const fs::path& store_folder) {
  const std::optional<Damage> damage = lasting_damage(store_folder);
  if (!damage) return;
  throw core::StoreError(log_path(store_folder).string() + ": this log, which a crash has left, is damaged " +
                         place(*damage) + ", and SQLite would drop " +
                         (damage->page == 0
                              ? std::string("all of it")
                              : "it from there on (" + core::counted(damage->lost, "page") + " of the catalogue)") +
                         "; nothing was touched. `lightstage store repair` keeps a copy and saves what can be");
}

LogRepair repair_log(const fs::path& store_folder) {
  LogRepair report;
  if (!lasting_damage(store_folder)) return report;
  const NobodyElse alone(catalogue_path(store_folder));
  if (!alone) {
    throw core::StoreError(
        store_folder.string() +
        ": the catalogue's log is damaged, and another program has the store open; end that, then repair");
  }
  std::optional<Damage> damage = Log(store_folder).look();
  if (!damage) return report;
  const fs::path path = log_path(store_folder);
  report.damaged_copy = keep_copy(path);
  Writer log(path);
  constexpr std::size_t kMostBits = 1000;
  for (; damage; damage = Log(store_folder).look()) {
    if (damage->wrong && report.bits < kMostBits) {
      log.flip(*damage->wrong);
      ++report.bits;
    } else {
      report.pages_lost += damage->lost;
      log.cut(damage->keep);
    }
  }
  return report;
}

}  // namespace lightstage::db
