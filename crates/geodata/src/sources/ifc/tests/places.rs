use super::read_text;
use super::shapes::{METRES, file, warnings};
use crate::sources::Layer;
use crate::sources::options::Options;
use crate::sources::place;
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;

const BLOCK: (&str, &str) = ("block", "@1=IFCBLOCK(#6,1.,1.,1.);");
const CRS: &str = "#201=IFCPROJECTEDCRS('EPSG:25832',$,$,$,$,$,$);\n";

/// Corners of the layer on the Earth [m].
fn corners(layer: &Layer) -> Vec<DVec3> {
    let all = layer.meshes.iter().flat_map(|mesh| {
        (0..mesh.positions.len() as u32).map(|k| layer.site.enu_to_ecef(mesh.vertex_m(k)))
    });
    all.collect()
}

/// The middle of a block of a metre, and its warnings.
fn middle(place: &str) -> (Geodetic, String) {
    middle_in(METRES, place)
}

fn middle_in(units: &str, place: &str) -> (Geodetic, String) {
    let layer = read_text(&file(units, place, &[BLOCK]), &Options::default()).unwrap();
    let all = corners(&layer);
    let middle = all.iter().sum::<DVec3>() / all.len() as f64;
    (Geodetic::from_ecef(middle), warnings(&layer))
}

fn refused(units: &str, place: &str) -> String {
    let text = file(units, place, &[BLOCK]);
    read_text(&text, &Options::default())
        .unwrap_err()
        .to_string()
}

/// How far a place lies from a point of the map [m].
fn off_m(found: Geodetic, east: f64, north: f64, height: f64) -> f64 {
    let crs = place::crs("EPSG:25832", &Options::default()).unwrap();
    let want = crs.to_ecef(DVec3::new(east, north, height)).unwrap();
    found.to_ecef().distance(want)
}

fn metres(unit: &str) -> String {
    METRES.replace("#3=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);", unit)
}

const MM: &str = "#3=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.);";
const FOOT: &str = "#3=IFCCONVERSIONBASEDUNIT($,.LENGTHUNIT.,'FOOT',#15);\n#15=IFCMEASUREWITHUNIT(IFCRATIOMEASURE(304.8),#16);\n\
    #16=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.);";

#[test]
fn units_are_applied_or_refused_by_name() {
    let map = |rest: &str| format!("#200=IFCMAPCONVERSION(#5,#201,{rest});\n{CRS}");
    let half = |unit_m: f64| 0.5 * unit_m;
    for (unit, unit_m) in [
        (MM, 1e-3),
        (FOOT, 0.3048),
        (&*FOOT.replace("304.8", "12").replace("#16)", "#17)").replace("#16=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.)", "#17=IFCCONVERSIONBASEDUNIT($,.LENGTHUNIT.,'INCH',#18);\n#18=IFCMEASUREWITHUNIT(IFCRATIOMEASURE(2.54),#19);\n#19=IFCSIUNIT(*,.LENGTHUNIT.,.CENTI.,.METRE.)"), 0.3048),
    ] {
        let place = map(&format!("{},{},{},1.,0.,$", 691e3 / unit_m, 5334e3 / unit_m, 520.0 / unit_m));
        let (found, said) = middle_in(&metres(unit), &place);
        assert!(off_m(found, 691e3 + half(unit_m), 5334e3 + half(unit_m), 520.0 + half(unit_m)) < 1e-2, "{unit}");
        assert!(!said.contains("taken in") && !said.contains("Scale"), "{said}");
    }
    let place = map("691000.,5334000.,520.,1.,0.,$");
    let (found, said) = middle_in("#2=IFCUNITASSIGNMENT(());", &place);
    assert!(off_m(found, 691000.5, 5334000.5, 520.5) < 1e-2);
    assert!(
        said.contains("no unit of length is assigned: taken as metres"),
        "{said}"
    );
    for (unit, word) in [
        (MM.replace("MILLI", "SMALL"), "SMALL"),
        (MM.replace(".METRE.", ".SECOND."), "SECOND"),
        (
            "#3=IFCCONTEXTDEPENDENTUNIT(#9,.LENGTHUNIT.,'cubit');".into(),
            "cubit",
        ),
        (FOOT.replace("304.8", "0."), "'FOOT'"),
        (FOOT.replace("#16)", "#3)"), "circle"),
    ] {
        let said = refused(&metres(&unit), &place);
        assert!(said.contains(word), "{word}: {said}");
    }
    let (_, said) = middle_in(
        &metres(&FOOT.replace("304.8", "300.")),
        &map("2303333.,17780000.,1733.,1.,0.,$"),
    );
    assert!(
        said.contains("instead of 0.3048 m: the factor counts"),
        "{said}"
    );
}

#[test]
fn a_conversion_with_scales_and_units_of_its_own_is_applied() {
    let metre = "#202=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);\n";
    let with_unit = CRS.replace("$);", "#202);");
    // Millimetres on a map in metres: the block is a millimetre, its model's origin 2 m east in it.
    let moved = "#10=IFCLOCALPLACEMENT($,#203);\n#203=IFCAXIS2PLACEMENT3D(#204,$,$);\n#204=IFCCARTESIANPOINT((2000.,0.,0.));\n";
    for (scale, system, word) in [
        ("0.001", &*with_unit, ""),
        ("$", &with_unit, "as if they were one"),
        ("1.", &with_unit, "as if they were one"),
        ("0.001", CRS, "turns the model's unit into metres"),
        ("$", CRS, "at the map's own origin"),
    ] {
        let place = format!(
            "#200=IFCMAPCONVERSION(#5,#201,691000.,5334000.,520.,1.,0.,{scale});\n{system}{metre}"
        );
        let text = file(&metres(MM), &place, &[BLOCK]);
        let text = text.replace("#10=IFCLOCALPLACEMENT($,#6);\n", moved);
        let layer = read_text(&text, &Options::default()).unwrap();
        let found = Geodetic::from_ecef(corners(&layer)[0]);
        assert!(
            off_m(found, 691002.0, 5334000.0, 520.0) < 5e-3,
            "{scale} {word}"
        );
        let said = warnings(&layer);
        assert_eq!(
            said.contains("IfcMapConversion"),
            !word.is_empty(),
            "{said}"
        );
        assert!(said.contains(word), "{said}");
    }
    // Scales of the axes: a block of a metre is 2 m by 3 m by 4 m.
    let scaled = format!(
        "#200=IFCMAPCONVERSIONSCALED(#5,#201,691000.,5334000.,520.,1.,0.,$,2.,3.,4.);\n{CRS}"
    );
    let (found, said) = middle(&scaled);
    assert!(off_m(found, 691001.0, 5334001.5, 522.0) < 1e-2);
    assert!(said.contains("2 m of the map"), "{said}");
    for (old, new, word) in [
        ("691000.", "$", "Eastings"),
        ("$,2.", "0.,2.", "Scale"),
        ("3.,4.", "-3.,4.", "FactorY"),
        (
            "IFCPROJECTEDCRS('EPSG:25832',$,$,$,$,$,$)",
            "IFCGEOGRAPHICCRS('EPSG:4326',$,$,$,$,$)",
            "IfcGeographicCRS",
        ),
    ] {
        assert!(
            refused(METRES, &scaled.replacen(old, new, 1)).contains(word),
            "{word}"
        );
    }
    let odd = "#202=IFCCONTEXTDEPENDENTUNIT(#9,.LENGTHUNIT.,'rod');\n";
    let said = refused(
        METRES,
        &format!("#200=IFCMAPCONVERSION(#5,#201,1.,1.,1.,1.,0.,1.);\n{with_unit}{odd}"),
    );
    assert!(said.contains("rod"), "{said}");
}

#[test]
fn rigid_operations_and_property_sets_place_a_model() {
    let rigid = format!(
        "#200=IFCRIGIDOPERATION(#5,#201,IFCLENGTHMEASURE(691000.),IFCLENGTHMEASURE(5334000.),520.);\n{CRS}"
    );
    assert!(off_m(middle(&rigid).0, 691000.5, 5334000.5, 520.5) < 1e-2);
    // About a longitude and latitude in the project's degrees.
    let angles = "#200=IFCRIGIDOPERATION(#5,#201,IFCPLANEANGLEMEASURE(11.5),IFCPLANEANGLEMEASURE(48.),520.);\n\
        #201=IFCGEOGRAPHICCRS('EPSG:4326',$,$,$,$,$);\n";
    let (found, said) = middle(angles);
    assert!(
        (found.latitude_rad.to_degrees() - 48.0).abs() < 1e-5
            && (found.longitude_rad.to_degrees() - 11.5).abs() < 1e-5
    );
    assert!(said.contains("taken as longitude 11.5"), "{said}");
    assert!(
        refused(
            METRES,
            &rigid.replacen("IFCLENGTHMEASURE(691000.)", "IFCPLANEANGLEMEASURE(1.)", 1)
        )
        .contains("mixes")
    );
    for set in [
        "ePSet_MapConversion",
        "ePset_MapConversion",
        "EPSET_MAPCONVERSION",
    ] {
        let sets = format!(
            "#200=IFCPROPERTYSET('a',$,'{set}',$,(#201,#202,#203,#204,#205));\n\
             #201=IFCPROPERTYSINGLEVALUE('Eastings',$,IFCLENGTHMEASURE(691000.),$);\n#202=IFCPROPERTYSINGLEVALUE('Northings',$,IFCLABEL('5334000'),$);\n\
             #203=IFCPROPERTYSINGLEVALUE('OrthogonalHeight',$,IFCLENGTHMEASURE(520000.),#210);\n\
             #204=IFCPROPERTYSINGLEVALUE('XAxisAbscissa',$,IFCREAL(0.),$);\n#205=IFCPROPERTYSINGLEVALUE('XAxisOrdinate',$,IFCREAL(2.),$);\n\
             #206=IFCPROPERTYSET('b',$,'ePset_ProjectedCRS',$,(#207,#208,#209));\n#207=IFCPROPERTYSINGLEVALUE('Name',$,IFCLABEL('EPSG:25832'),$);\n\
             #208=IFCPROPERTYSINGLEVALUE('MapUnit',$,IFCLABEL('METRE'),$);\n#209=IFCPROPERTYSINGLEVALUE('VerticalDatum',$,IFCLABEL('DHHN2016'),$);\n\
             #210=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.);\n"
        );
        // Turned by a quarter: x points north, y west.
        let (found, said) = middle(&sets);
        assert!(off_m(found, 690999.5, 5334000.5, 520.5) < 1e-2, "{set}");
        assert!(!said.contains("heights: "), "{said}");
    }
}

#[test]
fn heights_are_those_that_the_datum_says() {
    let map = |vertical: &str| {
        format!(
            "#200=IFCMAPCONVERSION(#5,#201,691000.,5334000.,520.,1.,0.,$);\n{}",
            CRS.replacen("$,$,$,$", &format!("$,$,{vertical},$"), 1)
        )
    };
    let (over_sea, said) = middle(&map("$"));
    assert!(
        said.contains("heights: ") && said.contains("--crs EPSG:25832+"),
        "{said}"
    );
    for (datum, ellipsoid, noted) in [
        ("'DHHN2016'", false, false),
        ("'EPSG:7837'", false, false),
        ("'WGS84 ellipsoid'", true, false),
        ("'mine'", false, true),
    ] {
        let (found, said) = middle(&map(datum));
        let geoid_m = over_sea.height_m - found.height_m;
        assert_eq!(geoid_m > 40.0, ellipsoid, "{datum}");
        assert_eq!(said.contains("'mine' is not known"), noted, "{said}");
        assert!(!said.contains("heights: "), "{said}");
    }
    let words = "#200=IFCMAPCONVERSION(#5,#201,691000.,5334000.,520.,1.,0.,$);\n#201=IFCPROJECTEDCRS('my map',$,'ETRS89','NN','UTM','32N',$);\n";
    let (found, said) = middle(words);
    assert!(
        off_m(found, 691000.5, 5334000.5, 520.5) < 1e-2
            && said.contains("'my map' is taken as EPSG:25832"),
        "{said}"
    );
    let text = "#201=IFCPROJECTEDCRS($,$,$,'NN',$,$,$);\n#202=IFCWELLKNOWNTEXT('PROJCRS[\"x\",BASEGEOGCRS[\"y\",ID[\"EPSG\",4258]],ID[\"EPSG\",25832]]',#201);\n";
    let text = format!("#200=IFCMAPCONVERSION(#5,#201,691000.,5334000.,520.,1.,0.,$);\n{text}");
    assert!(off_m(middle(&text).0, 691000.5, 5334000.5, 520.5) < 1e-2);
    assert!(refused(METRES, &words.replace("32N", "99")).contains("my map"));
}

/// A site about Munich.
const SITE: &str =
    "#200=IFCSITE('s',$,'Site',$,$,#10,$,$,.ELEMENT.,(48,8,0),(11,34,0),515.,$,$);\n";

#[test]
fn contradictions_are_said_and_the_map_counts() {
    let map = format!("#205=IFCMAPCONVERSION(#5,#201,691000.,5334000.,515.,1.,0.,$);\n{CRS}");
    let (_, said) = middle(&format!("{SITE}{map}"));
    assert!(
        !said.contains("contradicts") && !said.contains("km from where"),
        "{said}"
    );
    let (found, said) = middle(&format!(
        "{}{map}",
        SITE.replace("(48,8,0)", "(52,30,0)").replace("515.", "30.")
    ));
    assert!(off_m(found, 691000.5, 5334000.5, 515.5) < 1e-2);
    assert!(
        said.contains("km from where #205 IfcMapConversion puts the model")
            && said.contains("--georef"),
        "{said}"
    );
    assert!(
        said.contains("RefElevation of 30.0 m contradicts"),
        "{said}"
    );
    let turned = file(METRES, &format!("{SITE}{map}"), &[BLOCK])
        .replace("1.E-5,#6,$)", "1.E-5,#6,#210)")
        .replace(
            "ENDSEC;\nEND-",
            "#210=IFCDIRECTION((1.,0.));\nENDSEC;\nEND-",
        );
    let said = warnings(&read_text(&turned, &Options::default()).unwrap());
    assert!(said.contains("TrueNorth: it lies"), "{said}");
    // Coordinates of the map with a conversion to the map on top.
    let twice = file(METRES, &map, &[BLOCK])
        .replace(
            "#7=IFCCARTESIANPOINT((0.,0.,0.))",
            "#7=IFCCARTESIANPOINT((691010.,5334010.,515.))",
        )
        .replace("#10=IFCLOCALPLACEMENT($,#6)", "#10=IFCLOCALPLACEMENT($,$)")
        .replace("1.E-5,#6,$)", "1.E-5,$,$)");
    let layer = read_text(&twice, &Options::default()).unwrap();
    assert!(
        off_m(
            Geodetic::from_ecef(corners(&layer)[0]),
            691010.0,
            5334010.0,
            515.0
        ) < 2.0
    );
    assert!(warnings(&layer).contains("not applied again"));
    // A map without a conversion, and coordinates that are its own.
    let far = |place: &str| {
        file(METRES, place, &[BLOCK])
            .replace(
                "#7=IFCCARTESIANPOINT((0.,0.,0.))",
                "#7=IFCCARTESIANPOINT((691010.,5334010.,515.))",
            )
            .replace("1.E-5,#6,$)", "1.E-5,$,$)")
            .replace("#10=IFCLOCALPLACEMENT($,#6)", "#10=IFCLOCALPLACEMENT($,$)")
    };
    for place in [CRS.to_string(), format!("{SITE}{CRS}")] {
        let layer = read_text(&far(&place), &Options::default()).unwrap();
        assert!(
            off_m(
                Geodetic::from_ecef(corners(&layer)[0]),
                691010.0,
                5334010.0,
                515.0
            ) < 2.0
        );
        assert!(warnings(&layer).contains("no map conversion is stated"));
    }
    assert!(refused(METRES, CRS).contains("EPSG:25832 is named, but no map conversion"));
    let said = read_text(&far(SITE), &Options::default())
        .unwrap_err()
        .to_string();
    assert!(
        said.contains("km from the point") && said.contains("--crs"),
        "{said}"
    );
}

#[test]
fn of_several_sites_the_first_counts_and_a_building_tells_a_height() {
    let second = SITE
        .replace("#200", "#210")
        .replace("(48,8,0)", "(52,30,0)");
    let (found, said) = middle(&format!("{SITE}{second}"));
    assert!((found.latitude_rad.to_degrees() - 48.0 - 8.0 / 60.0).abs() < 1e-4);
    assert!(
        said.contains("#210 IfcSite: its latitude and longitude are not those of #200"),
        "{said}"
    );
    let (_, said) = middle(&format!("{SITE}{}", SITE.replace("#200", "#210")));
    assert!(said.is_empty(), "{said}");

    let building = |elevation: &str| {
        format!("#220=IFCBUILDING('b',$,'House',$,$,#10,$,$,.ELEMENT.,{elevation},$,$);\n")
    };
    let (stated, _) = middle(SITE);
    let (told, said) = middle(&format!(
        "{}{}",
        SITE.replace("515.", "$"),
        building("515.")
    ));
    assert!(stated.to_ecef().distance(told.to_ecef()) < 1e-6);
    assert!(
        said.contains("taken as 515.0 m over the sea, by ElevationOfRefHeight of #220"),
        "{said}"
    );
    let (found, said) = middle(&format!("{SITE}{}", building("530.")));
    assert!(stated.to_ecef().distance(found.to_ecef()) < 1e-6);
    assert!(
        said.contains("530.0 m over the sea, which contradicts"),
        "{said}"
    );
    for unset in ["$", "0.", "515."] {
        let (_, said) = middle(&format!("{SITE}{}", building(unset)));
        assert!(said.is_empty(), "{said}");
    }
    let map = format!("#205=IFCMAPCONVERSION(#5,#201,691000.,5334000.,515.,1.,0.,$);\n{CRS}");
    let (_, said) = middle(&format!("{SITE}{}{map}", building("30.")));
    assert!(
        said.contains("ElevationOfRefHeight of 30.0 m contradicts"),
        "{said}"
    );
}

#[test]
fn a_site_stands_at_its_latitude_with_true_north() {
    let (found, said) = middle(SITE);
    let site = |latitude: f64, longitude: f64, height: f64| {
        let wgs84 = place::crs("EPSG:4326+5773", &Options::default()).unwrap();
        SiteFrame::new(
            wgs84
                .to_geodetic(DVec3::new(longitude, latitude, height))
                .unwrap(),
        )
    };
    let (latitude, longitude) = (48.0 + 8.0 / 60.0, 11.0 + 34.0 / 60.0);
    let munich = site(latitude, longitude, 515.0);
    assert!(
        munich
            .ecef_to_enu(found.to_ecef())
            .distance(DVec3::splat(0.5))
            < 1e-3
            && said.is_empty(),
        "{said}"
    );
    // South of the equator by a signed zero, west by any minus.
    let (found, _) = middle(&SITE.replace("(48,8,0),(11,34,0)", "(-0,30,0),(-11,-34,-0,-500000)"));
    assert!((found.latitude_rad.to_degrees() + 0.5).abs() < 1e-4);
    assert!((found.longitude_rad.to_degrees() + longitude + 0.5 / 3600.0).abs() < 1e-4);
    for (angles, word) in [
        ("(95,0,0),(11,34,0)", "no place on Earth"),
        ("(48,61,0),(11,34,0)", "no place on Earth"),
        ("(48,8,0),$", "no place on Earth"),
        ("(0,0,0),(0,0,0)", ""),
    ] {
        let said = refused(METRES, &SITE.replace("(48,8,0),(11,34,0)", angles));
        assert!(said.contains("--crs"), "{word}: {said}");
    }
    let (_, said) = middle(&SITE.replace("515.", "$"));
    assert!(said.contains("RefElevation is not stated"), "{said}");
    // Its own placement is its reference point.
    let moved = format!(
        "{}#201=IFCLOCALPLACEMENT($,#202);\n#202=IFCAXIS2PLACEMENT3D(#203,$,$);\n#203=IFCCARTESIANPOINT((30.,40.,5.));\n",
        SITE.replace("#10", "#201")
    );
    let (found, said) = middle(&moved);
    assert!(
        munich
            .ecef_to_enu(found.to_ecef())
            .distance(DVec3::new(-29.5, -39.5, -4.5))
            < 1e-3
    );
    assert!(said.contains("placement's origin"), "{said}");
    let (_, said) = middle(&moved.replace("30.,40.", "3000.,4000."));
    assert!(said.contains("5.0 km from the point"), "{said}");
}

#[test]
fn conversions_that_are_not_set_give_way_to_the_site() {
    let unset = format!("#205=IFCMAPCONVERSION(#5,#201,0.,0.,0.,1.,0.,$);\n{CRS}");
    let nameless = "#205=IFCMAPCONVERSION(#5,#201,691000.,5334000.,0.,1.,0.,$);\n#201=IFCPROJECTEDCRS('',$,$,$,$,$,$);\n";
    for (place, word) in [
        (unset.as_str(), "taken as not set"),
        (nameless, "names no coordinate reference system"),
    ] {
        let (found, said) = middle(&format!("{SITE}{place}"));
        assert!((found.latitude_rad.to_degrees() - 48.0 - 8.0 / 60.0).abs() < 1e-4);
        assert!(said.contains(word) && said.contains("--georef"), "{said}");
        let said = refused(METRES, place);
        assert!(said.contains("--georef"), "{said}");
    }
}

#[test]
fn a_model_at_the_origin_of_its_map_is_a_warning() {
    let place = format!("#200=IFCMAPCONVERSION(#5,#201,100.,200.,0.,1.,0.,$);\n{CRS}");
    let (_, said) = middle(&place);
    assert!(said.contains("0.2 km from the map's own origin"), "{said}");
}

#[test]
fn maps_in_feet_are_met_in_their_own_feet() {
    // New York's Long Island plane counts US survey feet.
    let crs = place::crs("EPSG:2263", &Options::default()).unwrap();
    let survey = 1200.0 / 3937.0;
    let want = crs
        .to_ecef(DVec3::new(987_000.0, 195_000.0, 30.0 * survey))
        .unwrap();
    let map = |scale: &str, unit: &str| {
        format!(
            "#200=IFCMAPCONVERSION(#5,#201,987000.,195000.,30.,1.,0.,{scale});\n#201=IFCPROJECTEDCRS('EPSG:2263',$,$,$,$,$,{unit});\n\
        #202=IFCCONVERSIONBASEDUNIT($,.LENGTHUNIT.,'US SURVEY FOOT',#203);\n#203=IFCMEASUREWITHUNIT(IFCRATIOMEASURE(0.30480060960121924),#204);\n\
        #204=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);\n"
        )
    };
    for (units, place, own) in [
        (METRES.to_string(), map("3.2808333333", "#202"), false),
        (metres(FOOT), map("$", "$"), true),
        (metres(FOOT), map("1.", "#202"), false),
    ] {
        let text = file(&units, &place, &[BLOCK]);
        let layer = read_text(&text, &Options::default()).unwrap();
        let off_m = corners(&layer)
            .iter()
            .map(|r| r.distance(want))
            .fold(f64::INFINITY, f64::min);
        assert!(off_m < 2e-3, "{off_m} {place}");
        let said = warnings(&layer);
        assert_eq!(said.contains("taken as the map's own"), own, "{said}");
    }
    // A map in feet whose unit is said to be the metre.
    let text = file(METRES, &map("$", "#204"), &[BLOCK]);
    let said = warnings(&read_text(&text, &Options::default()).unwrap());
    assert!(said.contains("is not the map's own of 0.3048006"), "{said}");
}

/// A tetrahedron, written with other units, scales, turns, placements.
fn tetrahedron(points: &[DVec3]) -> String {
    let list: Vec<String> = points
        .iter()
        .map(|p| format!("({:.9},{:.9},{:.9})", p.x, p.y, p.z))
        .collect();
    format!(
        "@1=IFCTRIANGULATEDFACESET(@2,$,.T.,((1,3,2),(1,2,4),(2,3,4),(3,1,4)),$);@2=IFCCARTESIANPOINTLIST3D(({}));",
        list.join(",")
    )
}

const GROUND: [[f64; 3]; 4] = [
    [691000.0, 5334000.0, 520.0],
    [691030.0, 5334010.0, 521.0],
    [690990.0, 5334040.0, 519.0],
    [691005.0, 5334005.0, 560.0],
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// Another unit, map unit, scale, axis, world coordinate system and placement with values to match is the same ground.
    #[test]
    fn another_conversion_is_the_same_ground(
        unit in 0..4_usize, map_unit in 0..3_usize, scale in prop_oneof![Just(1.0), 0.9..1.1_f64], turn_rad in -3.1..3.1_f64,
        offset in prop::array::uniform3(-50.0..50.0_f64), world in prop::array::uniform3(-20.0..20.0_f64), own_rad in -3.1..3.1_f64,
    ) {
        let units = [("#3=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);", 1.0), (MM, 1e-3), (FOOT, 0.3048), ("#3=IFCSIUNIT(*,.LENGTHUNIT.,.CENTI.,.METRE.);", 0.01)];
        let (unit, unit_m) = units[unit];
        let (map_unit, map_m) = [("", unit_m), ("#202=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);\n", 1.0), ("#202=IFCSIUNIT(*,.LENGTHUNIT.,.DECI.,.METRE.);\n", 0.1)][map_unit];
        let origin = DVec3::from(GROUND[0]) + DVec3::from(offset);
        let stated = scale * unit_m / map_m;
        let axis = DVec2::from_angle(turn_rad);
        // From the map back to the model's unit, through world coordinate system and placement.
        let world = DVec3::from(world);
        let back = |p: [f64; 3]| {
            let arm = DVec3::from(p) - origin;
            let flat = DVec2::new(axis.x, -axis.y).rotate(arm.truncate()).extend(arm.z) / scale;
            DQuat::from_rotation_z(-own_rad) * ((flat - world) / unit_m - DVec3::new(3.0, 4.0, 5.0))
        };
        let points: Vec<DVec3> = GROUND.iter().map(|p| back(*p)).collect();
        let o = origin / map_m;
        let system = if map_unit.is_empty() { CRS.into() } else { CRS.replace("$);", "#202);") };
        let place = format!(
            "#200=IFCMAPCONVERSION(#5,#201,{:.9},{:.9},{:.9},{:.15},{:.15},{stated:.15});\n{system}{map_unit}", o.x, o.y, o.z, axis.x * 3.0, axis.y * 3.0
        );
        let w = world / unit_m;
        let placed = format!(
            "#5=IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-5,#30,$);\n#30=IFCAXIS2PLACEMENT3D(#31,$,$);\n#31=IFCCARTESIANPOINT(({:.9},{:.9},{:.9}));\n\
             #10=IFCLOCALPLACEMENT($,#32);\n#32=IFCAXIS2PLACEMENT3D(#33,#8,#34);\n#33=IFCCARTESIANPOINT((3.,4.,5.));\n#34=IFCDIRECTION(({:.15},{:.15},0.));\n",
            w.x, w.y, w.z, own_rad.cos(), own_rad.sin()
        );
        let text = |units: &str, place: &str, points: &[DVec3]| file(units, place, &[("tent", &tetrahedron(points))]);
        let other = text(&metres(unit), &place, &points)
            .replace("#5=IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-5,#6,$);\n", &placed)
            .replace("#10=IFCLOCALPLACEMENT($,#6);\n", "");
        let plain: Vec<DVec3> = GROUND.iter().map(|p| DVec3::from(*p) - DVec3::from(GROUND[0])).collect();
        let own = text(METRES, &format!("#200=IFCMAPCONVERSION(#5,#201,691000.,5334000.,520.,1.,0.,$);\n{CRS}"), &plain);
        let [own, other] = [own, other].map(|text| corners(&read_text(&text, &Options::default()).unwrap()));
        prop_assert_eq!(own.len(), 12);
        for (a, b) in own.iter().zip(&other) {
            // Corners in f32 about a middle: some micrometres.
            prop_assert!(a.distance(*b) < 1e-4, "{} {}", a, b);
        }
    }

    /// Another true north, unit and placement of the site with values to match is the same ground.
    #[test]
    fn another_north_is_the_same_ground(unit in 0..3_usize, north_rad in -3.1..3.1_f64, at in prop::array::uniform3(-500.0..500.0_f64)) {
        let (unit, unit_m) = [("#3=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);", 1.0), (MM, 1e-3), (FOOT, 0.3048)][unit];
        let shape: Vec<DVec3> = GROUND.iter().map(|p| DVec3::from(*p) - DVec3::from(GROUND[0])).collect();
        let at = DVec3::from(at);
        let turned: Vec<DVec3> = shape.iter().map(|r| (DQuat::from_rotation_z(north_rad) * *r + at) / unit_m).collect();
        let own = file(METRES, SITE, &[("tent", &tetrahedron(&shape))]);
        let site = SITE.replace("#10", "#30").replace("515.", &format!("{:?}", 515.0 / unit_m));
        let o = at / unit_m;
        let site = format!(
            "{site}#30=IFCLOCALPLACEMENT($,#31);\n#31=IFCAXIS2PLACEMENT3D(#32,$,$);\n#32=IFCCARTESIANPOINT(({:.9},{:.9},{:.9}));\n\
             #33=IFCDIRECTION(({:.15},{:.15}));\n", o.x, o.y, o.z, -north_rad.sin(), north_rad.cos()
        );
        let other = file(&metres(unit), &site, &[("tent", &tetrahedron(&turned))]).replace("1.E-5,#6,$)", "1.E-5,#6,#33)");
        let [own, other] = [own, other].map(|text| corners(&read_text(&text, &Options::default()).unwrap()));
        for (a, b) in own.iter().zip(&other) {
            prop_assert!(a.distance(*b) < 1e-4, "{} {}", a, b);
        }
    }
}
