mod places;
mod shapes;

use super::*;
use crate::sources::place;
use crate::sources::surfaces::volume_m3;
use boresight_common::warning::Notes;
use boresight_models::maths::geodesy::Geodetic;
use glam::DVec3;
use proptest::prelude::*;

/// A house in millimetres: a slab, a wall of an L-shaped outline, a B-rep, a triangulated tetrahedron, two mapped boxes (one mirrored),
/// a hollow column, a wall with an opening and a room, on a storey; it stands by its map conversion.
fn house(georeference: &str) -> String {
    let mut text = String::from(
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\nFILE_SCHEMA(('IFC4'));\nENDSEC;\nDATA;\n\
         #1=IFCPROJECT('p',$,'Project',$,$,$,$,(#5),#2);\n#2=IFCUNITASSIGNMENT((#3));\n#3=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.);\n\
         #5=IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-5,#6,$);\n#6=IFCAXIS2PLACEMENT3D(#7,$,$);\n#7=IFCCARTESIANPOINT((0.,0.,0.));\n\
         #8=IFCDIRECTION((0.,0.,1.));\n#9=IFCDIRECTION((0.,1.,0.));\n#10=IFCLOCALPLACEMENT($,#6);\n\
         #11=IFCBUILDING('b',$,'Tower',$,$,#10,$,$,$,$,$,$);\n#12=IFCBUILDINGSTOREY('s',$,'Level 1',$,$,#10,$,$,$,3000.);\n\
         #13=IFCSPACE('r',$,'101',$,$,#10,$,'Office',$,$,$);\n#14=IFCSITE('site',$,'Campus',$,$,#10,$,$,$,SITE,$,$);\n\
         #15=IFCRELAGGREGATES('a',$,$,$,#14,(#11));\n#16=IFCRELAGGREGATES('a2',$,$,$,#11,(#12));\n#17=IFCRELAGGREGATES('a3',$,$,$,#12,(#13));\n\
         #18=IFCRELCONTAINEDINSPATIALSTRUCTURE('c',$,$,$,(#20,#40,#50,#60,#70),#12);\n#19=IFCRELCONTAINEDINSPATIALSTRUCTURE('d',$,$,$,(#30),#13);\n",
    );
    // A slab of 10 m × 20 m × 0.3 m at 3 m.
    text += "#20=IFCSLAB('slab',$,'Slab',$,$,#21,#24,$,$);\n#21=IFCLOCALPLACEMENT(#10,#22);\n#22=IFCAXIS2PLACEMENT3D(#23,$,$);\n\
        #23=IFCCARTESIANPOINT((1000.,2000.,3000.));\n#24=IFCPRODUCTDEFINITIONSHAPE($,$,(#25));\n\
        #25=IFCSHAPEREPRESENTATION(#5,'Body','SweptSolid',(#26));\n#26=IFCEXTRUDEDAREASOLID(#27,$,#8,300.);\n\
        #27=IFCRECTANGLEPROFILEDEF(.AREA.,$,$,10000.,20000.);\n";
    // An L of 3 m² extruded by 4 m, turned on its side by its placement, outline clockwise.
    text += "#30=IFCWALL('wall',$,'Wall',$,'Brick',#31,#34,$,$);\n#31=IFCLOCALPLACEMENT(#21,#32);\n#32=IFCAXIS2PLACEMENT3D(#7,#9,#8);\n\
        #34=IFCPRODUCTDEFINITIONSHAPE($,$,(#35));\n#35=IFCSHAPEREPRESENTATION(#5,'Body','Clipping',(#39));\n\
        #39=IFCBOOLEANCLIPPINGRESULT(.DIFFERENCE.,#36,#90);\n#36=IFCEXTRUDEDAREASOLID(#37,#6,#8,4000.);\n\
        #37=IFCARBITRARYCLOSEDPROFILEDEF(.AREA.,$,#38);\n#38=IFCINDEXEDPOLYCURVE(#33,$,.F.);\n\
        #33=IFCCARTESIANPOINTLIST2D(((0.,0.),(0.,2000.),(1000.,2000.),(1000.,1000.),(2000.,1000.),(2000.,0.)));\n";
    // A B-rep of 1 m³ whose loops are all turned by their orientation.
    text += "#40=IFCBUILDINGELEMENTPROXY('brep',$,'Box',$,$,#10,#41,$,$);\n#41=IFCPRODUCTDEFINITIONSHAPE($,$,(#42));\n\
        #42=IFCSHAPEREPRESENTATION(#5,'Body','Brep',(#43));\n#43=IFCFACETEDBREP(#44);\n#44=IFCCLOSEDSHELL((#110,#120,#130,#140,#150,#160));\n";
    for k in 0..8 {
        let [x, y, z] = [k & 1, k >> 1 & 1, k >> 2].map(|b| 1000.0 * f64::from(b));
        text += &format!("#{}=IFCCARTESIANPOINT(({x:?},{y:?},{z:?}));\n", 100 + k);
    }
    let loops = [
        [0, 1, 3, 2],
        [4, 6, 7, 5],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 5, 7, 3],
    ];
    for (k, ring) in loops.iter().enumerate() {
        let n = 110 + 10 * k;
        let ids: Vec<String> = ring.iter().map(|c| format!("#{}", 100 + c)).collect();
        text += &format!(
            "#{n}=IFCFACE((#{}));\n#{}=IFCFACEOUTERBOUND(#{},.F.);\n#{}=IFCPOLYLOOP(({}));\n",
            n + 1,
            n + 1,
            n + 2,
            n + 2,
            ids.join(",")
        );
    }
    // A tetrahedron of 1/6 m³, and a hollow column.
    text += "#50=IFCFURNITURE('tet',$,'Tent',$,$,#10,#51,$,$);\n#51=IFCPRODUCTDEFINITIONSHAPE($,$,(#52));\n\
        #52=IFCSHAPEREPRESENTATION(#5,'Body','Tessellation',(#53));\n#53=IFCTRIANGULATEDFACESET(#54,$,.T.,((1,3,2),(1,2,4),(2,3,4),(3,1,4)),$);\n\
        #54=IFCCARTESIANPOINTLIST3D(((0.,0.,0.),(1000.,0.,0.),(0.,1000.,0.),(0.,0.,1000.)));\n";
    text += "#60=IFCCOLUMN('col',$,'Column',$,$,#10,#61,$,$);\n#61=IFCPRODUCTDEFINITIONSHAPE($,$,(#62));\n\
        #62=IFCSHAPEREPRESENTATION(#5,'Body','SweptSolid',(#63));\n#63=IFCEXTRUDEDAREASOLID(#64,#6,#8,1000.);\n\
        #64=IFCRECTANGLEHOLLOWPROFILEDEF(.AREA.,$,$,400.,200.,50.,$,$);\n";
    // Boxes of 2 m³ by way of a map: one twice as large, one mirrored.
    text += "#70=IFCBUILDINGELEMENTPROXY('maps',$,'Twins',$,$,#10,#71,$,$);\n#71=IFCPRODUCTDEFINITIONSHAPE($,$,(#72));\n\
        #72=IFCSHAPEREPRESENTATION(#5,'Body','MappedRepresentation',(#73,#74));\n#73=IFCMAPPEDITEM(#75,#76);\n#74=IFCMAPPEDITEM(#75,#77);\n\
        #75=IFCREPRESENTATIONMAP(#6,#78);\n#76=IFCCARTESIANTRANSFORMATIONOPERATOR3D($,$,#23,2.,$);\n\
        #77=IFCCARTESIANTRANSFORMATIONOPERATOR3D(#170,#171,#7,1.,#8);\n#170=IFCDIRECTION((1.,0.,0.));\n#171=IFCDIRECTION((0.,-1.,0.));\n\
        #78=IFCSHAPEREPRESENTATION(#5,'Body','SweptSolid',(#79));\n#79=IFCEXTRUDEDAREASOLID(#80,$,#8,1000.);\n\
        #80=IFCRECTANGLEPROFILEDEF(.AREA.,$,$,2000.,1000.);\n";
    // An opening is no product of its own; a damaged one is passed over.
    text += "#85=IFCOPENINGELEMENT('o',$,'Hole',$,$,#10,#24,$,$);\n#86=IFCWALL('w2',$,'Nothing',$,$,#999,#998,$,$);\n";
    text += georeference;
    text + "ENDSEC;\nEND-ISO-10303-21;\n"
}

/// 32N, turned by 30°, in millimetres like the project.
const MAP: &str = "#200=IFCMAPCONVERSION(#5,#201,691000000.,5334000000.,520000.,0.866025403784,0.5,$);\n\
    #201=IFCPROJECTEDCRS('EPSG:25832',$,$,$,$,$,$);\n";

fn read_text(text: &str, options: &Options) -> Result<Layer, SourceError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("house.ifc");
    std::fs::write(&path, text.replace("SITE,", "$,$,$,")).unwrap();
    read(&path, options)
}

fn number(layer: &Layer, name: &str) -> u32 {
    layer
        .features
        .iter()
        .position(|known| known["name"] == name)
        .unwrap() as u32
}

#[test]
fn products_have_their_volumes() {
    let layer = read_text(&house(MAP), &Options::default()).unwrap();
    let names: Vec<_> = layer
        .features
        .iter()
        .map(|known| known["name"].as_str().unwrap().to_string())
        .collect();
    assert_eq!(
        names,
        ["Slab", "Wall", "Box", "Tent", "Column", "Twins", "101"]
    );
    // UTM's scale there is 1.00005, its square on an area.
    for (name, want) in [
        ("Slab", 60.0),
        ("Wall", 12.0),
        ("Box", 1.0),
        ("Tent", 1.0 / 6.0),
        ("Column", 0.4 * 0.2 - 0.3 * 0.1),
        ("Twins", 16.0 + 2.0),
    ] {
        let found = volume_m3(&layer.meshes, Some(number(&layer, name)));
        assert!(
            (found / want - 1.0).abs() < 2e-3,
            "{name}: {found} against {want}"
        );
    }
}

#[test]
fn rooms_storeys_and_buildings_are_known() {
    let layer = read_text(&house(MAP), &Options::default()).unwrap();
    let known = |name: &str| &layer.features[number(&layer, name) as usize];
    let wall = known("Wall");
    assert_eq!(
        (
            wall["room"].as_str(),
            wall["storey"].as_str(),
            wall["building"].as_str()
        ),
        (Some("101"), Some("Level 1"), Some("Tower"))
    );
    assert_eq!(
        (wall["type"].as_str(), wall["object_type"].as_str()),
        (Some("IfcWall"), Some("Brick"))
    );
    assert_eq!(known("Slab")["storey"], "Level 1");
    let room = known("101");
    assert_eq!(
        (room["long_name"].as_str(), room["storey"].as_str()),
        (Some("Office"), Some("Level 1"))
    );
}

#[test]
fn it_stands_by_its_map_conversion_its_site_or_the_options() {
    let top_of_slab = |layer: &Layer| {
        let slab = number(layer, "Slab");
        let mesh = &layer.meshes[0];
        let own = (0..mesh.positions.len() as u32).filter(|k| mesh.features[*k as usize] == slab);
        let places: Vec<DVec3> = own
            .map(|k| layer.site.enu_to_ecef(mesh.vertex_m(k)))
            .collect();
        Geodetic::from_ecef(places.iter().sum::<DVec3>() / places.len() as f64)
    };
    let map = top_of_slab(&read_text(&house(MAP), &Options::default()).unwrap());
    let crs = place::crs("EPSG:25832", &Options::default()).unwrap();
    // The middle of the slab, (1, 2, 3.15) in the model, turned by 30°.
    let (sin, cos) = 30_f64.to_radians().sin_cos();
    let want = crs
        .to_geodetic(DVec3::new(
            691_000.0 + cos - 2.0 * sin,
            5_334_000.0 + sin + 2.0 * cos,
            523.15,
        ))
        .unwrap();
    assert!(
        map.to_ecef().distance(want.to_ecef()) < 0.01,
        "{map:?} {want:?}"
    );
    let site = house("").replace("SITE,", "(48,8,0),(11,34,0),515.,");
    let found =
        top_of_slab(&read_text(&site.replace("515.", "515000."), &Options::default()).unwrap());
    assert!((found.latitude_rad.to_degrees() - 48.0 - 8.0 / 60.0).abs() < 1e-4);
    assert!(
        (found.height_m - 515.0 - 3.15 - 45.8).abs() < 1.0,
        "{}",
        found.height_m
    );
    let options = Options {
        crs: Some("EPSG:25832".into()),
        ..Options::default()
    };
    let far = "#10=IFCLOCALPLACEMENT($,#300);\n#300=IFCAXIS2PLACEMENT3D(#301,$,$);\n#301=IFCCARTESIANPOINT((690999000.,5333998000.,0.));";
    let text = site.replace("#10=IFCLOCALPLACEMENT($,#6);", far);
    let found = top_of_slab(&read_text(&text, &options).unwrap());
    let want = crs
        .to_geodetic(DVec3::new(691_000.0, 5_334_000.0, 3.15))
        .unwrap();
    assert!(
        found.to_ecef().distance(want.to_ecef()) < 0.01,
        "{found:?} {want:?}"
    );
}

#[test]
fn bad_files_are_one_error_that_says_what_to_do() {
    let said = |text: &str| {
        read_text(text, &Options::default())
            .unwrap_err()
            .to_string()
    };
    assert!(said("").contains("ISO-10303-21"));
    assert!(said("ISO-10303-21;\n").contains("no product"));
    let nowhere = said(&house(""));
    assert!(
        nowhere.contains("--crs") && nowhere.contains("--georef"),
        "{nowhere}"
    );
    let unknown = said(&house(&MAP.replace("EPSG:25832", "EPSG:1")));
    assert!(unknown.contains("EPSG:1"), "{unknown}");
    // Placements and maps in circles come to an end.
    let circle = house(MAP).replace(
        "#10=IFCLOCALPLACEMENT($,#6)",
        "#10=IFCLOCALPLACEMENT(#21,#6)",
    );
    let circle = said(&circle);
    assert!(
        circle.contains("placements that run in a circle"),
        "{circle}"
    );
    let circle = house(MAP).replace("'SweptSolid',(#79)", "'SweptSolid',(#73,#74)");
    assert!(said(&circle).contains("multiply"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]
    #[test]
    fn damaged_files_never_panic(flips in prop::collection::vec((0..9000_usize, 0..7_u8), 1..8), cut in 0..12_000_usize) {
        let mut bytes = house(MAP).into_bytes();
        for (at, bit) in flips {
            let at = at % bytes.len();
            bytes[at] ^= 1 << bit;
        }
        bytes.truncate(cut.max(200));
        if let Ok(mut made) = products(&bytes) {
            let [low, high] = made.bounds();
            let options = Options::default();
            let placing = Placing { stated: &made.stated, unit_m: made.unit_m, middle_m: (low + high) / 2.0, options: &options };
            if let Ok(to_ecef) = placing.to_ecef(Path::new("house.ifc"), &mut made.notes) {
                let mut notes = Notes::default();
                let _ = layer(made, &to_ecef, &options, &mut notes);
            }
        }
    }
}
