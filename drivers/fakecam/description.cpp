// GenICam description of the camera, generated from one table: the features of a FLIR A655sc with their names and
// registers. Registers that only store their value are defined here alone.
#include <initializer_list>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "drivers/fakecam/camera_features.hpp"

namespace bolo::fakecam {
namespace {

using Kind = std::string_view;
constexpr Kind kInteger = "Integer";
constexpr Kind kFloat = "Float";
constexpr Kind kEnumeration = "Enumeration";
constexpr Kind kBoolean = "Boolean";
constexpr Kind kCommand = "Command";
constexpr Kind kText = "StringReg";

struct Register {
  std::uint32_t address;
  std::string_view access = "RO";
  int bytes = 4;
  std::string_view bits{};  // bit field of the value; empty: whole register
  std::string_view sign = "Unsigned";
};

// Initial value and limits of a register that only stores its value.
struct Kept {
  double start = 0.0;
  double min = 0.0;
  double max = 0.0;
};

struct Feature {
  Kind kind;
  std::string_view name;
  std::string_view tip;
  Register at;
  std::string content;  // of the node: limits, unit, entries
  std::string_view visibility;
  std::optional<Kept> kept{};
};
Feature feature(Kind kind, std::string_view name, std::string_view tip, const Register& at, std::string content = {},
                std::string_view visibility = "Beginner") {
  return {kind, name, tip, at, std::move(content), visibility};
}

struct Category {
  std::string_view name;
  std::vector<Feature> features;
};

std::string range(double min, double max) { return fmt::format("<Min>{:.10g}</Min><Max>{:.10g}</Max>", min, max); }

std::string in(std::string_view unit) { return fmt::format("<Unit>{}</Unit>", unit); }

std::string entry(std::string_view name, std::uint32_t number) {
  return fmt::format(R"(<EnumEntry Name="{}"><Value>{}</Value></EnumEntry>)", name, number);
}

// Numbered from 0.
std::string entries(std::initializer_list<std::string_view> names) {
  std::string text;
  for (std::uint32_t number = 0; const auto name : names) text += entry(name, number++);
  return text;
}

Feature constant(Kind kind, std::string_view name, std::string_view tip, std::uint32_t address, double value,
                 std::string content = {}) {
  Feature made = feature(kind, name, tip, {address}, std::move(content));
  made.kept = Kept{value};
  return made;
}

// A number that a client may write (parameter); one of several named values, stored by number (choice).
Feature parameter(Kind kind, std::string_view name, std::string_view tip, std::uint32_t address, const Kept& kept,
                  const std::string& unit = {}, std::string_view visibility = "Beginner") {
  Feature made = feature(kind, name, tip, {address, "RW"}, range(kept.min, kept.max) + unit, visibility);
  made.kept = kept;
  return made;
}
Feature choice(std::string_view name, std::string_view tip, std::uint32_t address,
               std::initializer_list<std::string_view> names, double start = 0.0) {
  Feature made = feature(kEnumeration, name, tip, {address, "RW"}, entries(names));
  made.kept = Kept{start, 0.0, static_cast<double>(names.size()) - 1.0};
  return made;
}

std::string value(int of_command) { return fmt::format("<CommandValue>{}</CommandValue>", of_command); }

std::vector<Category> categories() {
  const std::string any = range(0, 0xffffffff);
  constexpr std::string_view kLowHalf = "<LSB>31</LSB><MSB>16</MSB>";  // GenICam numbers bits from the most significant
  return {
      {"DeviceControl",
       {feature(kText, "DeviceVendorName", "Name of the manufacturer", {reg::kManufacturer, "RO", 32}),
        feature(kText, "DeviceModelName", "Name of the model", {reg::kModel, "RO", 32}),
        feature(kText, "DeviceVersion", "Version of the device", {reg::kDeviceVersion, "RO", 32}),
        feature(kText, "DeviceManufacturerInfo", "More about the device", {reg::kManufacturerInfo, "RO", 48}),
        feature(kText, "DeviceSerialNumber", "Serial number", {reg::kSerial, "RO", 16}),
        feature(kText, "DeviceID", "Serial number, under its older name", {reg::kSerial, "RO", 16}),
        feature(kText, "DeviceUserID", "Name given by the user", {reg::kUserName, "RW", 16}),
        constant(kFloat, "DeviceTemperature", "Temperature of the housing", 0xa120, 35.0, in("C"))}},
      {"ImageFormatControl",
       {feature(kInteger, "SensorWidth", "Columns of the sensor", {reg::kSensorWidth}, any),
        feature(kInteger, "SensorHeight", "Rows of the sensor", {reg::kSensorHeight}, any),
        feature(kInteger, "WidthMax", "Largest width", {reg::kSensorWidth}, any),
        feature(kInteger, "HeightMax", "Largest height", {reg::kSensorHeight}, any),
        feature(kInteger, "Width", "Columns of the image; centred unless OffsetX was written", {reg::kWidth, "RW"},
                "<Min>1</Min><pMax>WidthMax</pMax><Inc>1</Inc>"),
        feature(kInteger, "Height", "Rows of the image; centred unless OffsetY was written", {reg::kHeight, "RW"},
                "<Min>1</Min><pMax>HeightMax</pMax><Inc>1</Inc>"),
        feature(kInteger, "OffsetX", "First column of the image", {reg::kOffsetX, "RW"},
                "<Min>0</Min><pMax>OffsetXMax</pMax><Inc>1</Inc>"),
        feature(kInteger, "OffsetY", "First row of the image", {reg::kOffsetY, "RW"},
                "<Min>0</Min><pMax>OffsetYMax</pMax><Inc>1</Inc>"),
        feature(kEnumeration, "PixelFormat", "Format of a pixel", {reg::kPixelFormat, "RW"},
                entry("Mono16", gvsp::kMono16))}},
      {"AcquisitionControl",
       {choice("AcquisitionMode", "How many frames a start asks for", reg::kAcquisitionMode,
               {"Continuous", "SingleFrame"}),
        feature(kCommand, "AcquisitionStart", "Starts the stream", {reg::kAcquisitionStart, "RW"}, value(1)),
        feature(kCommand, "AcquisitionStop", "Stops the stream", {reg::kAcquisitionStop, "RW"}, value(1)),
        feature(kFloat, "AcquisitionFrameRate", "Frames a second; taken over at the next start",
                {reg::kFrameRate, "RW"}, range(0.01, 10000) + in("Hz")),
        choice("TriggerSelector", "Which trigger the next feature is about", 0xa034, {"FrameStart"}),
        choice("TriggerMode", "The camera runs freely", 0xa038, {"Off"})}},
      {"InfraredControl",
       {feature(kEnumeration, "IRFormat", "What a count means", {reg::kIrFormat, "RW"},
                entries({"Radiometric", "TemperatureLinear100mK", "TemperatureLinear10mK"})),
        feature(kEnumeration, "IRWindowing", "Rows that are read: all, the middle half, the middle quarter",
                {reg::kIrWindowing, "RW"}, entries({"Off", "Half", "Quarter"})),
        choice("IRFrameRate", "Frame rate of the whole sensor; kept only, the replayed capture sets the pace", 0xa108,
               {"Rate50Hz", "Rate25Hz", "Rate12Hz", "Rate6Hz", "Rate3Hz"}),
        choice("NUCMode", "When the camera corrects its non-uniformity", 0xa10c, {"Off", "Automatic"}, 1),
        feature(kCommand, "NUCAction", "Corrects the non-uniformity now", {reg::kNucAction, "RW"}, value(1)),
        feature(kInteger, "NUCCount", "How often NUCAction was executed", {reg::kNucCount}, any),
        feature(kCommand, "AutoFocus", "Focuses", {reg::kAutoFocus, "RW"}, value(1)),
        parameter(kInteger, "FocusPos", "Position of the focus", 0xa11c, {0, 0, 65535})}},
      // Emissivity and transmission 1: black-body temperatures, as in the paper.
      {"ObjectParameters",
       {parameter(kFloat, "ReflectedTemperature", "Temperature that the object reflects", 0xa140, {293.15, 0, 5000},
                  in("K")),
        parameter(kFloat, "AtmosphericTemperature", "Temperature of the air", 0xa144, {293.15, 0, 5000}, in("K")),
        parameter(kFloat, "ObjectDistance", "Distance of the object", 0xa148, {1, 0, 10000}, in("m")),
        parameter(kFloat, "ObjectEmissivity", "Emissivity of the object", reg::kObjectEmissivity, {1, 0.001, 1}),
        parameter(kFloat, "RelativeHumidity", "Humidity of the air", 0xa150, {0.5, 0, 1}),
        parameter(kFloat, "ExtOpticsTemperature", "Temperature of a window before the lens", 0xa154, {293.15, 0, 5000},
                  in("K")),
        parameter(kFloat, "ExtOpticsTransmission", "Transmission of a window before the lens", 0xa158, {1, 0.001, 1}),
        parameter(kFloat, "EstimatedTransmission", "Transmission of the air", 0xa15c, {1, 0, 1})}},
      {"MeasurementRanges",
       {feature(kInteger, "NumCases", "Number of ranges", {reg::kNumCases}, any),
        feature(kInteger, "QueryCase", "Range that the limits are about", {reg::kQueryCase, "RW"}, range(0, 2)),
        feature(kFloat, "QueryCaseLowLimit", "Its lowest temperature", {reg::kQueryCaseLowLimit}, in("K")),
        feature(kFloat, "QueryCaseHighLimit", "Its highest temperature", {reg::kQueryCaseHighLimit}, in("K")),
        parameter(kInteger, "CurrentCase", "Range in use", 0xa190, {0, 0, 2})}},
      {"PlanckConstants",
       {constant(kInteger, "R", "Planck constant R", 0xa1c0, kPlanck.r, any),
        constant(kInteger, "J0", "Offset of the radiance counts", 0xa1c4, kPlanck.j0, any),
        constant(kFloat, "B", "Planck constant B, K", 0xa1c8, kPlanck.b),
        constant(kFloat, "F", "Planck constant F", 0xa1cc, kPlanck.f),
        constant(kFloat, "J1", "Gain of the radiance counts", 0xa1d0, kPlanck.j1),
        constant(kFloat, "X", "Attenuation of the air: X", 0xa1d4, 1.9),
        constant(kFloat, "alpha1", "Attenuation of the air: alpha1", 0xa1d8, 0.006569),
        constant(kFloat, "alpha2", "Attenuation of the air: alpha2", 0xa1dc, 0.01262),
        constant(kFloat, "beta1", "Attenuation of the air: beta1", 0xa1e0, -0.002276),
        constant(kFloat, "beta2", "Attenuation of the air: beta2", 0xa1e4, -0.00667)}},
      {"TransportLayerControl",
       {feature(kInteger, "PayloadSize", "Bytes of an image", {reg::kPayloadSize}, any),
        parameter(kInteger, "TLParamsLocked", "Whether the client has locked the image format", 0xa030, {0, 0, 1}, {},
                  "Invisible"),
        feature(kInteger, "GevHeartbeatTimeout", "Silence after which the camera leaves its client",
                {reg::kHeartbeatTimeout, "RW"}, range(500, 0xffffffff) + in("ms"), "Guru"),
        feature(kInteger, "GevTimestampTickFrequency", "Ticks of a second of the time stamps",
                {reg::kTickFrequencyLow - 4, "RO", 8}, in("Hz"), "Expert"),
        feature(kCommand, "GevTimestampControlLatch", "Latches the clock into GevTimestampValue",
                {reg::kTimestampControl, "WO"}, value(reg::kTimestampLatch), "Expert"),
        feature(kCommand, "GevTimestampControlReset", "Sets the clock to 0", {reg::kTimestampControl, "WO"},
                value(reg::kTimestampReset), "Expert"),
        feature(kCommand, "GevTimestampControlLatchReset", "Latches the clock and sets it to 0",
                {reg::kTimestampControl, "WO"}, value(reg::kTimestampLatch | reg::kTimestampReset), "Expert"),
        feature(kInteger, "GevTimestampValue", "The clock when it was latched", {reg::kTimestampHigh, "RO", 8},
                in("ns"), "Expert"),
        feature(kBoolean, "PtpEnable", "The clock follows a PTP master (IEEE 1588)", {reg::kPtpEnable, "RW"}, {},
                "Expert"),
        feature(kCommand, "PtpDataSetLatch", "Latches PtpStatus and PtpOffsetFromMaster", {reg::kPtpLatch, "WO"},
                value(1), "Expert"),
        feature(kEnumeration, "PtpStatus", "State of the clock when it was latched", {reg::kPtpStatus},
                entries({"Initializing", "Faulty", "Disabled", "Listening", "PreMaster", "Master", "Passive",
                         "Uncalibrated", "Slave"}),
                "Expert"),
        feature(kInteger, "PtpOffsetFromMaster", "How far the clock was from its master's when it was latched",
                {reg::kPtpOffset, "RO", 4, {}, "Signed"}, in("ns"), "Expert"),
        feature(kEnumeration, "GevCCP", "Who may write", {reg::kPrivilege, "RW"},
                entries({"OpenAccess", "ExclusiveAccess", "ControlAccess"}), "Guru"),
        feature(kInteger, "GevSCPHostPort", "UDP port that the stream goes to; 0 closes it",
                {reg::kStreamPort, "RW", 4, kLowHalf}, range(0, 65535) + "<Inc>1</Inc>", "Expert"),
        feature(kInteger, "GevSCPSPacketSize", "Bytes of a packet with its IP and UDP headers",
                {reg::kStreamPacketSize, "RW", 4, kLowHalf},
                range(gvsp::kMinPacketSize, gvsp::kMaxPacketSize) + "<Inc>4</Inc>", "Expert"),
        feature(kBoolean, "GevSCPSDoNotFragment", "Refuse packets that the link would split",
                {reg::kStreamPacketSize, "RW", 4, "<Bit>1</Bit>"}, {}, "Guru"),
        feature(kCommand, "GevSCPSFireTestPacket", "Sends one packet of GevSCPSPacketSize",
                {reg::kStreamPacketSize, "RW", 4, "<Bit>0</Bit>"}, value(1), "Guru"),
        feature(kInteger, "GevSCPD", "Ticks between packets", {reg::kStreamPacketDelay, "RW"}, range(0, 1e7), "Expert"),
        feature(kInteger, "GevSCDA", "IPv4 address that the stream goes to", {reg::kStreamAddress, "RW"},
                any + "<Representation>IPV4Address</Representation>", "Guru"),
        feature(kInteger, "GevSCSP", "UDP port that the stream comes from", {reg::kStreamSourcePort}, any, "Guru")}}};
}

std::string place(const Register& at) {
  return fmt::format(
      "<Address>{:#x}</Address><Length>{}</Length><AccessMode>{}</AccessMode><pPort>Device</pPort>"
      "<Cachable>NoCache</Cachable>",
      at.address, at.bytes, at.access);
}

// XML node of the feature and of its register; a text feature is its own register.
std::string nodes(const Feature& described) {
  const auto& [kind, name, tip, at, content, visibility, kept] = described;
  const std::string about = fmt::format("<ToolTip>{}</ToolTip><Visibility>{}</Visibility>", tip, visibility);
  if (kind == kText) return fmt::format("<StringReg Name=\"{}\">{}{}</StringReg>\n", name, about, place(at));
  const std::string from = fmt::format("<pValue>{}Reg</pValue>", name);
  const bool entries_first = kind == kEnumeration;
  std::string text =
      fmt::format("<{0} Name=\"{1}\">{2}{3}{4}{5}</{0}>\n", kind, name, about, entries_first ? content : from,
                  entries_first ? from : content, kind == kBoolean ? "<OnValue>1</OnValue><OffValue>0</OffValue>" : "");
  const std::string_view integer = at.bits.empty() ? "IntReg" : "MaskedIntReg";
  const std::string sign = kind == kFloat ? "" : fmt::format("{}<Sign>{}</Sign>", at.bits, at.sign);
  return text + fmt::format("<{0} Name=\"{1}Reg\">{2}{3}<Endianess>BigEndian</Endianess></{0}>\n",
                            kind == kFloat ? "FloatReg" : integer, name, place(at), sign);
}

std::string category(std::string_view name, const std::string& names) {
  return fmt::format("<Category Name=\"{}\">{}</Category>\n", name, names);
}

std::string feature_name(std::string_view name) { return fmt::format("<pFeature>{}</pFeature>", name); }

std::string make_description() {
  std::string root;
  std::string all;
  for (const Category& c : categories()) {
    root += feature_name(c.name);
    std::string names;
    for (const Feature& f : c.features) names += feature_name(f.name);
    all += category(c.name, names);
    for (const Feature& f : c.features) all += nodes(f);
  }
  for (const auto& [axis, size] : {std::pair("X", "Width"), std::pair("Y", "Height")}) {
    all += fmt::format(
        "<IntSwissKnife Name=\"Offset{0}Max\"><pVariable Name=\"SENSOR\">Sensor{1}</pVariable>"
        "<pVariable Name=\"SIZE\">{1}</pVariable><Formula>SENSOR - SIZE</Formula></IntSwissKnife>\n",
        axis, size);
  }
  return R"(<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="A655sc_Bolo_fake" VendorName="FLIR_Systems"
 ToolTip="Replays captures as a FLIR A655sc would send them" StandardNameSpace="GEV" SchemaMajorVersion="1"
 SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" SubMinorVersion="0"
 ProductGuid="6d1b0c6e-6b3f-4a57-9f1c-0f6a55c5cfa1" VersionGuid="0c6b8b42-55d1-4f0e-8a54-2b7a655cb010"
 xmlns="http://www.genicam.org/GenApi/Version_1_1" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
 xsi:schemaLocation="http://www.genicam.org/GenApi/Version_1_1
 http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd">
)" + category("Root", root) +
         all + "<Port Name=\"Device\"></Port>\n</RegisterDescription>\n";
}

}  // namespace

std::string_view description() {
  static const std::string text = make_description();
  return text;
}

void fill_kept(RegisterMap& registers) {
  const auto fill = [&registers](const Register& at, const Kept& kept, bool real) {
    const auto word = [](double value) { return static_cast<std::uint32_t>(value); };
    const auto number = [](double value) { return static_cast<float>(value); };
    real ? registers.set_float(at.address, number(kept.start)) : registers.set(at.address, word(kept.start));
    if (at.access != "RW") return;
    real ? registers.writable_float(at.address, number(kept.min), number(kept.max))
         : registers.writable_range(at.address, word(kept.min), word(kept.max));
  };
  for (const Category& c : categories()) {
    for (const Feature& f : c.features) {
      if (f.kept) fill(f.at, *f.kept, f.kind == kFloat);
    }
  }
}

}  // namespace bolo::fakecam
