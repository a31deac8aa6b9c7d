// The store: a folder with a SQLite catalogue (store.sqlite) and content-addressed EXR objects
// (objects/ab/abcdef….exr).
//
// What is acknowledged is kept: put_frame returns only after the object is synced and its row committed.
// Every derived thing (mask, calibration, alignment, weights, virtual stage, picture) is a product row with
// its inputs, parameters and the program's version, so that any picture can be traced to the frames it came
// from.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/image.h"
#include "core/light_list.h"
#include "db/content_hash.h"
#include "db/unsynced_object.h"

namespace lightstage::db {

using Id = std::int64_t;  // a database key; 0 is never one

enum class ScanKind { kOlat, kMirrorBall, kGreyBall, kChessboard, kImported, kVirtual };
std::string_view to_string(ScanKind kind);

// What a step lights: one light, all lights for tracking motion, all lights, nothing, or a pattern of its
// own.
enum class StepKind { kLight, kTracking, kFullOn, kDark, kPattern };
std::string_view to_string(StepKind kind);

// The explicit step table: which pattern lit which frame. Nothing is inferred from file order.
struct Step {
  int step_index = 0;
  StepKind kind = StepKind::kLight;
  std::optional<int> light_index = std::nullopt;  // for kLight: counts from 0 in the stage's list of lights
  std::int64_t exposure_ns = 0;                   // 0 for imported pictures
  std::string pattern = {};                       // for kPattern: JSON [[light_index, r, g, b], ...]; else empty
};

struct NewScan {
  std::string name;  // unique in the store; letters, digits, '-', '_' and '.', not starting with '.'
  ScanKind kind = ScanKind::kOlat;
  std::string stage_key;  // scans with one key stand on the same lights: a calibration of one serves all
  // JSON: everything needed to know how it came about (stage, sequence, simulation, source files); empty stands for {}.
  std::string provenance;
  std::vector<std::string> cameras;  // names, unique in the scan
  std::vector<Step> steps;
};

struct Scan : NewScan {
  Id id = 0;
  std::string created_utc;
  std::string program_version;
};

// The step of this index. Throws StoreError when the scan has none, which only a damaged or foreign catalogue can say of a frame.
const Step& step_of(const Scan& scan, int step_index);

struct NewFrame {
  Id scan_id = 0;
  std::string camera;
  int step_index = 0;
  std::int64_t timestamp_ns = 0;
  std::int64_t sequence_number = 0;
  int attempt = 1;        // 1 for the first try, more for retakes
  double saturation = 0;  // the value at which the sensor clips, in the image's units; 0 when unknown
};

struct Frame : NewFrame {
  Id id = 0;
  ContentHash object;
};

// A frame whose picture is written but not yet durable (Store::begin_frame).
struct UnsyncedFrame {
  NewFrame frame;
  UnsyncedObject object;
};

// An image that belongs to a product, such as one aligned frame.
struct ProductImage {
  std::string role;  // "mask", "aligned", "weights_preview", ...
  int index = 0;     // step_index for "aligned"
  ContentHash object;
  double value = 0;  // a figure of merit, such as the alignment residual
};

// Kinds besides those named below: "camera_calibration" (lenses and poses of a stage's cameras in `parameters`, for its stage_key).
struct NewProduct {
  std::string kind;           // "mask", "calibration", "flat_field", "colour", "alignment", "weights", "virtual_stage",
                              // "picture", "normals"
  std::string name;           // may be empty; unique per kind where not empty
  std::optional<Id> scan_id;  // the scan it describes
  std::string stage_key;      // for calibrations, flat fields and colour: the stage it describes
  std::string parameters;     // JSON, empty stands for {}; a mask or alignment of a scan with several cameras
                              // says which one it is for: {"camera": NAME} (without: the scan's first)
  std::vector<Id> input_scans;
  std::vector<Id> input_products;
  std::vector<ProductImage> images;
};

// One light of a calibration. Lights that could not be placed are listed with placed = false and a reason.
struct CalibratedLight {
  int light_index = 0;
  bool placed = true;
  core::Light light;
  double sigma_degrees = 0;  // how sure the direction is; 0 when unknown
  std::string reason;
};

struct Product : NewProduct {
  Id id = 0;
  std::string created_utc;
  std::string program_version;
};

struct VerifyOptions {
  std::vector<std::string> scans;  // only these, with what was derived from them; empty: everything
  // Goes on after the scans that an interrupted verification of everything had done, if there was one.
  bool resume = false;
};

// What `store verify` found. Empty errors mean a sound store.
struct VerifyReport {
  std::size_t frames = 0;
  std::size_t objects = 0;
  std::size_t scans_done_before = 0;  // by the verification that was resumed; the counts hold theirs too
  std::vector<std::string> errors;    // one line each, naming scan, step and camera, or the object
  // Harmless: objects that nothing refers to (a crash or remove_scan leaves them), stray files.
  std::vector<std::string> notes;
};

struct BackupReport {
  std::size_t objects = 0;  // that the backup holds
  std::size_t copied = 0;   // of them now
  std::uint64_t copied_bytes = 0;
  std::vector<std::string>
      damaged;  // objects of the store that are damaged or missing, and what they belong to; the backup lacks them, or keeps
                // the sound copies that it had
  // What the folder's earlier catalogue had and the store has no more, a line a scan or kind of row; that catalogue is kept here then.
  std::vector<std::string> gone;
  std::filesystem::path kept_catalogue;
};

struct GarbageReport {
  std::size_t objects = 0, files = 0;  // removed: objects that nothing refers to, and what interrupted writes left
  std::uint64_t bytes = 0;
  std::size_t kept_young = 0;  // that nothing refers to (yet)
};

struct RepairReport {
  std::vector<std::string> mended;  // objects and what they belong to
  std::vector<std::string> lost;    // of which no sound copy was found; left as they are
};

struct CatalogueRepair {
  bool made_anew = false;              // it was damaged or missing
  std::filesystem::path damaged_copy;  // where the damaged one is now; empty where there was none
  std::size_t rows_read = 0;           // of the damaged catalogue, which count before those of backups
  std::size_t rows_from_backups = 0;   // that the catalogue lacked
  std::size_t rows_dropped = 0;        // that referred to rows which could be read nowhere
  bool accepted = false;               // taken as it was
  // What a damaged catalogue that was put aside (now or earlier) knew, and the present one lacks: a line a scan or kind of row.
  std::vector<std::string> lost;
  // Scans and products of backups whose number or name belongs to another one here: they were left out.
  std::vector<std::string> clashes;
  // Of the log that a crash had left, before that.
  std::filesystem::path log_copy;  // where the damaged one was copied to; empty: it was sound
  std::size_t log_bits = 0;        // flipped bits that were put right
  std::size_t log_pages_lost = 0;  // pages of transactions that could not be saved
};

// A scan's row and how much belongs to it.
struct ScanSummary {
  std::string name;
  ScanKind kind = ScanKind::kOlat;
  std::string created_utc;
  std::size_t steps = 0, frames = 0;
  std::vector<std::string> cameras;
};

// One connection to one store; use one per thread. Functions throw StoreError (with the store's path) when
// the database or disk fails, and UsageError for names that do not exist (with the nearest name) or exist
// already.
class Store {
 public:
  // Makes the folder and an empty store; UsageError when one is there already, or the objects of one.
  static Store create(const std::filesystem::path& folder);
  // Opens an existing one and migrates older schemas. StoreError for a newer schema (the store is not
  // touched), for a missing store (saying how to make one) and for a file that is no store.
  static Store open(const std::filesystem::path& folder);

  Store(Store&&) noexcept;
  Store& operator=(Store&&) noexcept;
  ~Store();

  const std::filesystem::path& folder() const;

  // Runs `work` in one transaction: what it adds through this store becomes durable and visible to others all
  // at once when it returns, and nothing of it stays when it throws (objects' files apart, which are
  // harmless). May be nested. Other writers wait meanwhile, so put objects first and add only rows in here.
  void atomically(const std::function<void()>& work);

  // Throws StoreError when a quick check of the catalogue's pages and rows finds something, as it does in one that was damaged or made by somebody who
  // means harm. Catalogues of more than 4 MiB are not checked here, but by verify().
  void require_sound_catalogue() const;

  // Throws StoreError when the store can only be read (a disk mounted read-only, another owner): to know before long work.
  void require_writable() const;

  // --- scans
  // The scan, its cameras and its steps in one transaction. UsageError for a name that is taken or not
  // allowed, BadInput for steps or JSON that make no sense.
  Id add_scan(const NewScan& scan);
  // Appends steps to a scan, whose provenance, which tells of them, is replaced by the one given; one transaction. What was there stays.
  // BadInput as add_scan, also for a step_index that the scan has.
  void extend_scan(Id scan_id, const std::vector<Step>& steps, const std::string& provenance);
  // Throws what add_scan would for this name: to know before long work.
  void require_free_name(const std::string& name) const;
  Scan scan(std::string_view name) const;
  Scan scan(Id id) const;
  std::optional<Scan> find_scan(std::string_view name) const;
  std::vector<Scan> scans() const;  // in order of creation
  // The same order. Counts without reading steps and frames: a second for millions of them.
  std::vector<ScanSummary> scan_summaries() const;
  // Removes the scan with its frames and products' rows, and the entries of weights that were trained on it, which it
  // returns: their files stay. Objects that nothing refers to any more stay on disk. UsageError
  // when something else was made from it (another scan's product), which would lose its origin. For undoing an import or
  // capture that failed before its first frame was acknowledged, and for `store rm`.
  std::vector<Product> remove_scan(Id scan_id);

  // --- frames
  // Writes the image as an object and commits the frame's row, replacing a frame of the same scan, camera and
  // step (a retake). Throws BadInput for a non-finite image, a step or camera the scan does not have, or a
  // size that differs from the camera's other frames.
  Id put_frame(const NewFrame& frame, core::ImageView image);
  // The same in two halves, for cameras that do not wait for the disk. Begun, a frame's picture is encoded and on its way to the disk, but
  // nobody sees it, and it is gone when the process dies. Finished, all of the frames are durable; they go into one transaction, and wait for the disk's
  // journal together. Pictures are not compressed: compressing takes longer than writing (docs/reliability.md).
  // begin_frame needs no connection: it may be called from several threads. Throw as put_frame.
  UnsyncedFrame begin_frame(const NewFrame& frame, core::ImageView image) const;
  std::vector<Id> finish_frames(std::vector<UnsyncedFrame> frames);
  // The row alone, for an object that put_object has stored. Throws as put_frame.
  Id add_frame(const NewFrame& frame, const ContentHash& object);
  std::vector<Frame> frames(Id scan_id, std::string_view camera) const;  // in order of step
  std::vector<Frame> frames(Id scan_id) const;                           // in order of step, then camera

  // --- objects
  // Stores an image (half floats, clamped to +-65504), synced, and returns its name; writing the same image twice
  // keeps one (and mends it, should the one on disk be damaged). Takes no part in transactions: until a frame or
  // product refers to it, it is only a file. Throws BadInput for an image that is empty, not finite or has more than
  // 4 channels.
  ContentHash put_object(core::ImageView image);
  // StoreError naming the object when it is missing or its bytes do not match the name. Needs no connection: may be called from several threads.
  core::Image object(const ContentHash& hash) const;
  core::ImageSize object_size(const ContentHash& hash) const;  // from catalogue or file header, without decoding
  std::filesystem::path object_path(const ContentHash& hash) const;

  // --- products
  // UsageError when the kind has one of that name already; BadInput for parameters that are not JSON or
  // figures that are not finite.
  Id add_product(const NewProduct& product);
  // A product of kind "calibration" with its lights. BadInput for a light listed twice or a gain that is not
  // positive.
  Id add_calibration(const NewProduct& product, const std::vector<CalibratedLight>& lights);
  std::vector<Product> products(std::string_view kind) const;  // oldest first
  std::optional<Product> newest_product(std::string_view kind, Id scan_id) const;
  // The newest one that is for this camera, as NewProduct::parameters says.
  std::optional<Product> newest_product(std::string_view kind, const Scan& scan, std::string_view camera) const;
  std::optional<Product> product(std::string_view kind, std::string_view name) const;
  std::optional<Product> newest_calibration(std::string_view stage_key) const;
  // The newest product of a kind that describes a stage's camera ("flat_field", "colour"); one whose parameters name no camera is for all.
  std::optional<Product> newest_of_camera(std::string_view kind, std::string_view stage_key,
                                          std::string_view camera) const;
  std::vector<CalibratedLight> calibrated_lights(Id calibration_id) const;  // in order of light_index

  // --- keeping (docs/reliability.md)
  // Checks the schema, foreign keys, every object's bytes against its name, that everything named in the
  // catalogue is there, that every step has its frame, and that the step table agrees with the pixels: a
  // frame lit by one calibrated light must resemble the frames of the neighbouring lights more than those
  // around a light elsewhere (swapped frames stand out; virtual scans have nothing to swap). Reads every object once, at the disk's
  // speed, on all threads. Works scan by scan and holds no long transaction, so that others go on writing; notes the scans done in verify.json, for
  // VerifyOptions::resume. Of single scans the catalogue as a whole is not checked. UsageError for scans that are not there.
  VerifyReport verify(const VerifyOptions& options = {}) const;

  // Copies what the store holds now into the folder, which is made, or holds an earlier backup of this same store: only what it lacks is copied,
  // each object checked against its name, and the catalogue comes last, in one piece. So an interrupted backup leaves the earlier one
  // whole, and the same call goes on. Others may write meanwhile. A backup is a store itself. What the store has no more stays in the
  // backup: objects, and the earlier catalogue where it had rows that the new one lacks (BackupReport::kept_catalogue). Throws UsageError for a folder that holds
  // another store, or lies in this one or round it; StoreError when another copy into that folder is under way, or its catalogue is damaged.
  BackupReport back_up(const std::filesystem::path& folder) const;
  // The backup (its folder, or a catalogue that it has kept) as a store in a folder that holds none yet. Interrupted, it goes on when called again; there is no
  // store there before all is. Throws UsageError for a folder that holds a store, or objects that the backup does not know.
  static BackupReport restore(const std::filesystem::path& backup, const std::filesystem::path& folder);

  // Removes objects that nothing refers to, and files that interrupted writes left, when they are older than `age`: a younger one may be about to be
  // referred to by a program at work. With `only_look` nothing is removed. Others may write meanwhile, and wait for a moment now and then. What kept catalogues
  // refer to stays. StoreError while a copy into this folder is under way, and while what a repair has put aside is there.
  GarbageReport collect_garbage(std::chrono::seconds age, bool only_look = false);

  // Mends the log that a crash has left, where it is damaged (db/store/log_damage.h), and makes a new catalogue where the one in the folder is missing or damaged: of every row on a sound page, and of what backups (folders or kept catalogues, the
  // newest last) have. The damaged one is kept beside it, or a mark that there was none. A sound one is left as it is, but for rows that it
  // lacks of the backups: while a damaged one lies beside it, and from kept catalogues. One that is whole, but has pages that do not match their checksums, is
  // with `accept` taken as it is. Throws StoreError when nothing can be read, another program has the store open, or neither backups nor `accept` say
  // what to do; UsageError for a backup of another store: by its identity or, where the catalogue's own is lost, when not even half of its objects are here.
  static CatalogueRepair repair_catalogue(const std::filesystem::path& folder,
                                          const std::vector<std::filesystem::path>& backups, bool accept = false);
  // Mends damaged and missing objects by sound copies: from backups (as above), and from what interrupted writes left. An object is replaced only by
  // bytes that match its name; nothing is removed. Reads every object that is referred to.
  RepairReport repair(const std::vector<std::filesystem::path>& backups);

 private:
  struct Impl;
  explicit Store(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace lightstage::db
