// SPDX-License-Identifier: Apache-2.0
#include <regista/canopen/eds.hpp>

#include "bench.hpp"

namespace regista::canopen {
namespace {

const std::string data = TEST_DATA "/canopen/";

std::string error_of(const std::string& text) {
  try {
    (void)parse_eds(text, "x.eds");
  } catch (const EdsError& error) {
    return error.what();
  }
  return "no error";
}

TEST(Eds, is_read_with_types_access_and_defaults) {
  const ObjectDictionary drive = load_eds(data + "drive.eds", NodeId{5});
  EXPECT_EQ(drive.vendor, "regista");
  EXPECT_EQ(drive.product, "Test drive");
  const ObjectEntry& target = *drive.find({0x60FF, 0});
  EXPECT_EQ(target.name, "Target velocity");
  EXPECT_EQ(target.type, DataType::integer32);
  EXPECT_EQ(target.access, Access::read_write);
  EXPECT_TRUE(target.mappable);
  EXPECT_EQ(target.value, (Bytes{0, 0, 0, 0}));
  EXPECT_EQ(drive.find({0x1018, 1})->name, "Identity object / Vendor-ID");
  EXPECT_EQ(drive.find({0x1014, 0})->value, (Bytes{0x85, 0, 0, 0})) << "$NODEID+0x80";
  EXPECT_EQ(drive.find({0x1401, 1})->value, (Bytes{0x05, 0x03, 0, 0}));
  EXPECT_EQ(drive.find({0x2007, 0})->low, -10);
  EXPECT_EQ(drive.find({0x2007, 0})->high, 100);
  EXPECT_EQ(drive.find({0x2006, 0})->value, Bytes{3}) << "CompactSubObj";
  EXPECT_EQ(format(DataType::integer16, drive.find({0x2006, 3})->value), "-7");
  EXPECT_EQ(drive.find({0x2006, 4}), nullptr);
  EXPECT_EQ(drive.find({0x2004, 0})->type, DataType::real32);
}

TEST(Eds, of_other_projects_can_be_read) {
  EXPECT_EQ(load_eds(data + "DS301_profile.eds", NodeId{3}).find({0x1800, 1})->value, (Bytes{0x83, 1, 0, 0xC0}));
  const ObjectDictionary ros = load_eds(data + "cia402_slave.eds", NodeId{3});
  EXPECT_EQ(ros.vendor, "ROS-Industrial");
  EXPECT_NE(ros.find({0x6040, 0}), nullptr);
}

TEST(Eds, errors_name_file_and_line) {
  const std::string object = "[6040]\nParameterName=Controlword\n";
  EXPECT_EQ(error_of("nonsense\n"), "x.eds:1: neither [section] nor key=value: 'nonsense'");
  EXPECT_EQ(error_of("a=1\n"), "x.eds:1: a key before the first [section]");
  EXPECT_EQ(error_of("\n[a\n"), "x.eds:2: '[' without ']'");
  EXPECT_EQ(error_of("[a]\n[b]\n[A]\n"), "x.eds:3: section [A] is there twice, first in line 1");
  EXPECT_EQ(error_of(object), "x.eds:1: [6040] has no DataType");
  EXPECT_EQ(error_of(object + "DataType=0x99\n"), "x.eds:3: no DataType of CiA 301: 0x99");
  EXPECT_EQ(error_of(object + "DataType=foo\n"), "x.eds:3: 'foo' is no number");
  EXPECT_EQ(error_of(object + "DataType=6\nAccessType=yes\n"),
            "x.eds:4: no AccessType: 'yes' (ro, wo, rw, rwr, rww, const)");
  EXPECT_EQ(error_of(object + "DataType=6\nDefaultValue=70000\n"), "x.eds:4: '70000' does not fit into 16 bits");
  EXPECT_EQ(error_of(object + "DataType=6\nDefaultValue=$NODEID+\n"), "x.eds:4: '$NODEID+' is no number");
  EXPECT_EQ(error_of("[OptionalObjects]\nSupportedObjects=1\n1=0x6040\n"),
            "x.eds:3: [OptionalObjects] names 0x6040, which has no section");
  EXPECT_EQ(error_of("[DeviceComissioning]\nNodeID=128\n"), "x.eds:2: NodeID 128 is not from 1 to 127");
  EXPECT_THROW((void)load_eds("/nowhere.eds"), EdsError);
}

TEST(Eds, takes_numbers_in_every_way_that_cia_306_has) {
  const auto value = [](const std::string& text) {
    const ObjectDictionary one = parse_eds(
        "[2000]\r\nParameterName=x ; a comment\r\nDataType=0x0007\r\nDefaultValue=" + text + "\r\n", "x", NodeId{5});
    return get_le(one.find({0x2000, 0})->value);
  };
  EXPECT_EQ(value("0x1F"), 31U);
  EXPECT_EQ(value("017"), 15U);
  EXPECT_EQ(value("17"), 17U);
  EXPECT_EQ(value("$NODEID+0x200"), 0x205U);
  EXPECT_EQ(value("0x200+$NodeId"), 0x205U);
  EXPECT_EQ(value("$NODEID"), 5U);
  EXPECT_EQ(value(""), 0U);
  EXPECT_EQ(parse_eds("[2000]\nParameterName=x ; a comment\nDataType=7\n", "x").find({0x2000, 0})->name, "x");
}

TEST(Dcf, becomes_writes_that_set_pdos_up_in_order) {
  const ObjectDictionary dcf = parse_eds(R"([DeviceComissioning]
NodeID=0x7
Baudrate=500
[1017]
ParameterName=Producer heartbeat time
DataType=6
ParameterValue=100
[1000]
ParameterName=Device type
DataType=7
AccessType=ro
ParameterValue=1
[1400]
ParameterName=RPDO
ObjectType=9
[1400sub1]
ParameterName=COB-ID
DataType=7
ParameterValue=$NODEID+0x200
[1400sub2]
ParameterName=Type
DataType=5
ParameterValue=255
[1600]
ParameterName=Mapping
ObjectType=8
DataType=7
CompactSubObj=2
[1600Value]
NrOfEntries=2
1=0x60400010
2=0x60FF0020
[6083]
ParameterName=Acceleration
DataType=7
ParameterValue=0x100
)",
                                         "x.dcf");
  EXPECT_EQ(dcf.node, 7);
  EXPECT_EQ(dcf.bit_rate, 500'000);
  const std::vector<SdoWrite> writes = dcf.configuration();
  std::vector<std::pair<ObjectIndex, std::uint64_t>> found;
  for (const SdoWrite& write : writes) found.emplace_back(write.object, get_le(write.value));
  const std::vector<std::pair<ObjectIndex, std::uint64_t>> wanted{
      {{0x1017, 0}, 100}, {{0x6083, 0}, 0x100},      {{0x1400, 1}, 0x80000207},
      {{0x1400, 2}, 255}, {{0x1400, 1}, 0x00000207},
  };
  // The mapping's number of objects is read-only here (CompactSubObj), so the mapping itself is left as it is.
  EXPECT_EQ(found, wanted);

  const Bytes concise = concise_dcf(writes);
  EXPECT_EQ(Bytes(concise.begin(), concise.begin() + 13), (Bytes{5, 0, 0, 0, 0x17, 0x10, 0, 2, 0, 0, 0, 100, 0}));
  const auto back = parse_concise_dcf(concise);
  ASSERT_TRUE(back);
  ASSERT_EQ(back->size(), writes.size());
  for (std::size_t i = 0; i < writes.size(); ++i) {
    EXPECT_EQ((*back)[i].object, writes[i].object);
    EXPECT_EQ((*back)[i].value, writes[i].value);
  }
  EXPECT_FALSE(parse_concise_dcf(ByteView{concise}.first(20)));
  EXPECT_FALSE(parse_concise_dcf({}));
}

TEST(ObjectDictionary, finds_objects_by_number_and_by_name) {
  const ObjectDictionary drive = load_eds(data + "drive.eds", NodeId{5});
  EXPECT_EQ(*drive.parse("6040"), (ObjectIndex{0x6040, 0}));
  EXPECT_EQ(*drive.parse("0x1018:04"), (ObjectIndex{0x1018, 4}));
  EXPECT_EQ(*drive.parse("controlword"), (ObjectIndex{0x6040, 0}));
  EXPECT_EQ(*drive.parse("Identity object / Serial number"), (ObjectIndex{0x1018, 4}));
  EXPECT_EQ(*drive.parse("serial number"), (ObjectIndex{0x1018, 4}));
  EXPECT_EQ(
      drive.parse("event timer").error().what.find("several objects are called 'event timer'; did you mean 1400:05"),
      0U);
  EXPECT_EQ(drive.parse("velocity").error().what,
            "no object 'velocity'; did you mean 606C:00 'Velocity actual value', 60FF:00 'Target velocity'");
}

TEST(Values, go_to_text_and_back) {
  for (const auto& [type, text] : std::initializer_list<std::pair<DataType, const char*>>{
           {DataType::integer8, "-128"},
           {DataType::unsigned16, "65535"},
           {DataType::integer24, "-8388608"},
           {DataType::unsigned64, "18446744073709551615"},
           {DataType::integer64, "-9223372036854775808"},
           {DataType::visible_string, "a b"},
           {DataType::domain, "01 FF"},
           {DataType::boolean, "1"},
           {DataType::real32, "1.500000"},
       }) {
    const auto bytes = encode(type, text);
    ASSERT_TRUE(bytes) << text;
    EXPECT_EQ(format(type, *bytes), text);
  }
  EXPECT_EQ(*encode(DataType::integer16, "0xFFFF"), (Bytes{0xFF, 0xFF}));
  EXPECT_FALSE(encode(DataType::integer16, "65535"));
  EXPECT_FALSE(encode(DataType::unsigned8, "-1"));
  EXPECT_FALSE(encode(DataType::unsigned8, "256"));
  EXPECT_FALSE(encode(DataType::unsigned8, "1x"));
  EXPECT_FALSE(encode(DataType::unsigned8, ""));
  EXPECT_FALSE(encode(DataType::real32, "x"));
  EXPECT_FALSE(encode(DataType::time_of_day, "0102"));
}

TEST(PdoMapping, packs_bits) {
  const PdoMapping mapping{{{0x6041, 0}, 16}, {{0x2000, 1}, 4}, {{0x2000, 2}, 12}, {{0x606C, 0}, 32}};
  EXPECT_EQ(mapping.size_bytes(), 8);
  EXPECT_EQ(mapping.position({0x606C, 0}), 3U);
  std::array<std::uint8_t, 8> bytes{};
  mapping.set(bytes, 0, 0x1234);
  mapping.set(bytes, 1, 0xFA);
  mapping.set(bytes, 2, 0x801);
  mapping.set(bytes, 3, static_cast<std::uint32_t>(-5));
  EXPECT_EQ(bytes, (std::array<std::uint8_t, 8>{0x34, 0x12, 0x1A, 0x80, 0xFB, 0xFF, 0xFF, 0xFF}));
  EXPECT_EQ(mapping.get_signed(bytes, 1), -6);
  EXPECT_EQ(mapping.get(bytes, 2), 0x801U);
  EXPECT_EQ(mapping.get_signed(bytes, 3), -5);
  EXPECT_EQ(mapping.get(ByteView{bytes}.first(7), 3), 0U) << "a short PDO";
  EXPECT_THROW(PdoMapping({{{0x6041, 0}, 40}, {{0x606C, 0}, 32}}), std::invalid_argument);
  EXPECT_THROW((void)mapping.position({0x6040, 0}), std::invalid_argument);
}

// A Sevcon Gen4's battery current, -25.5 A, which another driver takes for unsigned: 4070.5 A.
TEST(PdoMapping, keeps_the_sign_of_a_regenerating_current) {
  const PdoMapping mapping{{{0x5100, 1}, 16}, {{0x5100, 2}, 16}};
  const Bytes bytes{0x00, 0x03, 0x68, 0xFE};
  EXPECT_DOUBLE_EQ(static_cast<double>(mapping.get_signed(bytes, 1)) * 0.0625, -25.5);
}

}  // namespace
}  // namespace regista::canopen
