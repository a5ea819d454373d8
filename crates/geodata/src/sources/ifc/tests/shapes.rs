use super::{number, read_text};
use crate::sources::Layer;
use crate::sources::options::Options;
use crate::sources::surfaces::volume_m3;
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// A point on the equator's meridian of UTM 32N, where the map's scale is 0.9996.
const MAP: &str = "#200=IFCMAPCONVERSION(#5,#201,500000.,5334000.,520.,1.,0.,$);\n\
    #201=IFCPROJECTEDCRS('EPSG:25832',$,$,$,$,$,$);\n";

/// A file of beams, each with one item; `@k` is the k-th record of its own.
pub fn file(units: &str, place: &str, items: &[(&str, &str)]) -> String {
    let mut text = format!(
        "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('IFC4'));\nENDSEC;\nDATA;\n\
         #1=IFCPROJECT('p',$,'Project',$,$,$,$,(#5),#2);\n{units}\n\
         #5=IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-5,#6,$);\n#6=IFCAXIS2PLACEMENT3D(#7,$,$);\n\
         #7=IFCCARTESIANPOINT((0.,0.,0.));\n#8=IFCDIRECTION((0.,0.,1.));\n#9=IFCDIRECTION((0.,1.,0.));\n\
         #10=IFCLOCALPLACEMENT($,#6);\n#11=IFCAXIS2PLACEMENT2D(#12,$);\n#12=IFCCARTESIANPOINT((0.,0.));\n{place}"
    );
    for (k, (name, item)) in items.iter().enumerate() {
        let base = 1000 * (k + 1);
        text += &format!(
            "#{base}=IFCBEAM('{name}',$,'{name}',$,$,#10,#{},$,$);\n#{}=IFCPRODUCTDEFINITIONSHAPE($,$,(#{}));\n\
             #{}=IFCSHAPEREPRESENTATION(#5,'Body','SweptSolid',(#{}));\n",
            base + 901,
            base + 901,
            base + 902,
            base + 902,
            base + 1
        );
        let mut item = item.to_string();
        for own in (1..100).rev() {
            item = item.replace(&format!("@{own}"), &format!("#{}", base + own));
        }
        text += &item.replace(";", ";\n");
    }
    text + "ENDSEC;\nEND-ISO-10303-21;\n"
}

/// Metres and degrees.
pub const METRES: &str = "#2=IFCUNITASSIGNMENT((#3,#4));\n#3=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);\n\
    #4=IFCCONVERSIONBASEDUNIT($,.PLANEANGLEUNIT.,'DEGREE',#13);\n#13=IFCMEASUREWITHUNIT(IFCPLANEANGLEMEASURE(0.017453292519943295),#14);\n\
    #14=IFCSIUNIT(*,.PLANEANGLEUNIT.,$,.RADIAN.);";

pub fn warnings(layer: &Layer) -> String {
    let lines: Vec<String> = layer.warnings.iter().map(ToString::to_string).collect();
    lines.join("\n")
}

#[test]
fn the_odd_profiles_are_seven_products() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("../shared/data/odd/ifc-profiles.ifc");
    if !path.exists() {
        println!("skipped: {} is absent", path.display());
        return;
    }
    let layer = super::read(&path, &Options::default()).unwrap();
    assert_eq!(layer.features.len(), 7);
    // Areas of the outlines times 50 m; UTM's scale there is 1.00005.
    for (name, want) in [
        ("Slab", 600.0),
        ("U", 50.0 * (2.0 * 2.0 * 0.2 + 2.6 * 0.2)),
        ("T", 50.0 * (2.0 * 0.2 + 2.8 * 0.2)),
        ("Z", 50.0 * (2.0 * 2.0 * 0.2 + 2.6 * 0.2)),
        ("C", 50.0 * 0.2 * (3.0 + 2.0 * 1.8 + 2.0 * 0.3)),
        ("Trapezium", 50.0 * 9.0),
        ("AsymI", 50.0 * 0.2 * (2.0 + 1.0 + 2.6)),
    ] {
        let found = volume_m3(&layer.meshes, Some(number(&layer, name)));
        assert!(
            (found / want - 1.0).abs() < 2e-3,
            "{name}: {found} against {want}"
        );
    }
    assert!(
        !warnings(&layer).contains("left out"),
        "{}",
        warnings(&layer)
    );
}

/// An extrusion of 10 m of the profile in record 2.
const UP: &str = "@1=IFCEXTRUDEDAREASOLID(@2,$,#8,10.);";

#[test]
fn profiles_of_every_kind_have_their_areas() {
    // A 32-gon for a circle.
    let circle = |r: f64| 16.0 * r * r * (TAU / 32.0).sin();
    let line = "@3=IFCPOLYLINE((@4,@5,@6));@4=IFCCARTESIANPOINT((0.,0.));@5=IFCCARTESIANPOINT((4.,0.));@6=IFCCARTESIANPOINT((4.,3.));";
    let square = "@10=IFCRECTANGLEPROFILEDEF(.AREA.,$,$,2.,1.);";
    let half = |trims: &str, sense: &str| {
        format!(
            "@2=IFCARBITRARYCLOSEDPROFILEDEF(.AREA.,$,@3);@3=IFCCOMPOSITECURVE((@4,@5),.F.);@4=IFCCOMPOSITECURVESEGMENT(.CONTINUOUS.,.T.,@6);\
             @5=IFCCOMPOSITECURVESEGMENT(.CONTINUOUS.,.T.,@7);@6=IFCTRIMMEDCURVE(@8,{trims},{sense});@8=IFCCIRCLE(#11,2.);\
             @7=IFCPOLYLINE((@20,@21));@20=IFCCARTESIANPOINT((-2.,0.));@21=IFCCARTESIANPOINT((2.,0.));"
        )
    };
    let both = "(IFCPARAMETERVALUE(0.),@21),(IFCPARAMETERVALUE(180.),@20)";
    let cases: Vec<(&str, String, f64)> = vec![
        ("centre line", format!("@2=IFCCENTERLINEPROFILEDEF(.AREA.,$,@3,.2);{line}"), 7.0 * 0.2),
        ("derived", format!("@2=IFCDERIVEDPROFILEDEF(.AREA.,$,@10,@3,$);{square}@3=IFCCARTESIANTRANSFORMATIONOPERATOR2D($,$,#12,3.);"), 18.0),
        ("unlike scales", format!("@2=IFCDERIVEDPROFILEDEF(.AREA.,$,@10,@3,$);{square}@3=IFCCARTESIANTRANSFORMATIONOPERATOR2DNONUNIFORM($,$,#12,3.,2.);"), 12.0),
        ("mirrored", format!("@2=IFCMIRROREDPROFILEDEF(.AREA.,$,@10,*,$);{square}"), 2.0),
        ("composite", format!("@2=IFCCOMPOSITEPROFILEDEF(.AREA.,$,(@10,@11),$);{square}@11=IFCCIRCLEPROFILEDEF(.AREA.,$,@12,1.);@12=IFCAXIS2PLACEMENT2D(@13,$);@13=IFCCARTESIANPOINT((9.,0.));"), 2.0 + circle(1.0)),
        ("trimmed by parameters", half(both, ".T.,.PARAMETER."), circle(2.0) / 2.0),
        ("trimmed by points", half("(@21),(@20)", ".T.,.CARTESIAN."), circle(2.0) / 2.0),
        ("against the sense", half("(@21),(@20)", ".F.,.CARTESIAN."), circle(2.0) / 2.0),
        ("rounded", "@2=IFCROUNDEDRECTANGLEPROFILEDEF(.AREA.,$,$,4.,4.,1.);".into(), 12.0 + circle(1.0)),
        ("spline", "@2=IFCARBITRARYCLOSEDPROFILEDEF(.AREA.,$,@3);@3=IFCBSPLINECURVEWITHKNOTS(1,(@4,@5,@6,@4),.POLYLINE_FORM.,.T.,.F.,(2,1,1,2),(0.,1.,2.,3.),.UNSPECIFIED.);\
            @4=IFCCARTESIANPOINT((0.,0.));@5=IFCCARTESIANPOINT((4.,0.));@6=IFCCARTESIANPOINT((4.,3.));".into(), 6.0),
        ("hollow", "@2=IFCCIRCLEHOLLOWPROFILEDEF(.AREA.,$,$,1.,.5);".into(), circle(1.0) - circle(0.5)),
        ("L", "@2=IFCLSHAPEPROFILEDEF(.AREA.,$,$,3.,2.,.5,$,$,$,$,$);".into(), 2.25),
        // The slope leaves the flanges' mean thickness.
        ("sloped U", "@2=IFCUSHAPEPROFILEDEF(.AREA.,$,$,3.,2.,.2,.2,$,$,5.);".into(), 2.0 * 1.8 * (0.2 - 5_f64.to_radians().tan() * 0.1) + 3.0 * 0.2),
    ];
    let items: Vec<(&str, String)> = cases
        .iter()
        .map(|(name, text, _)| (*name, format!("{UP}{text}")))
        .collect();
    let items: Vec<(&str, &str)> = items.iter().map(|(n, t)| (*n, t.as_str())).collect();
    let layer = read_text(&file(METRES, MAP, &items), &Options::default()).unwrap();
    assert!(
        !warnings(&layer).contains("left out"),
        "{}",
        warnings(&layer)
    );
    for (name, _, area) in cases {
        let found = volume_m3(&layer.meshes, Some(number(&layer, name)));
        let want = 10.0 * area / 0.9996_f64.powi(2);
        assert!(
            (found / want - 1.0).abs() < 1e-3,
            "{name}: {found} against {want}"
        );
    }
}

#[test]
fn shells_inside_out_are_turned_and_the_largest_loop_is_the_outline() {
    // A cube of 2 m with a square hole of 1 m on its lid alone, whose loops have no outer one, all turned inwards or outwards.
    let corner = |k: usize| [k & 1, k >> 1 & 1, k >> 2].map(|b| 2 * b);
    let mut points: Vec<[f64; 3]> = (0..8).map(|k| corner(k).map(|v| v as f64)).collect();
    points.extend([
        [0.5, 0.5, 2.0],
        [1.5, 0.5, 2.0],
        [1.5, 1.5, 2.0],
        [0.5, 1.5, 2.0],
    ]);
    let brep = |turned: &str, lid: &str| {
        let loops: [(&[usize], &str); 6] = [
            (&[0, 2, 3, 1], ""),
            (&[4, 5, 7, 6], lid),
            (&[0, 1, 5, 4], ""),
            (&[2, 6, 7, 3], ""),
            (&[0, 4, 6, 2], ""),
            (&[1, 3, 7, 5], ""),
        ];
        let mut text =
            String::from("@1=IFCFACETEDBREP(@2);@2=IFCCLOSEDSHELL((@10,@20,@30,@40,@50,@60));");
        for (k, [x, y, z]) in points.iter().enumerate() {
            text += &format!("@{}=IFCCARTESIANPOINT(({x:?},{y:?},{z:?}));", 70 + k);
        }
        let names = |ring: &[usize]| {
            ring.iter()
                .map(|k| format!("@{}", 70 + k))
                .collect::<Vec<_>>()
                .join(",")
        };
        for (k, (ring, more)) in loops.iter().enumerate() {
            let n = 10 * (k + 1);
            text += &format!(
                "@{n}=IFCFACE(({more}@{}));@{}=IFCFACEBOUND(@{},{turned});@{}=IFCPOLYLOOP(({}));",
                n + 1,
                n + 1,
                n + 2,
                n + 2,
                names(ring)
            );
        }
        text + &format!(
            "@90=IFCFACEBOUND(@91,.T.);@91=IFCPOLYLOOP(({}));",
            names(&[8, 11, 10, 9])
        )
    };
    let [out, inside_out] = [".T.", ".F."].map(|turned| brep(turned, ""));
    let holed = brep(".T.", "@90,");
    let text = file(
        METRES,
        MAP,
        &[("out", &out), ("in", &inside_out), ("holed", &holed)],
    );
    let layer = read_text(&text, &Options::default()).unwrap();
    for name in ["out", "in"] {
        let volume = volume_m3(&layer.meshes, Some(number(&layer, name)));
        assert!((volume / 8.0 - 1.0).abs() < 2e-3, "{name}: {volume}");
    }
    // The lid is 4 m² less its hole, not the hole alone.
    let number = number(&layer, "holed");
    let lid_m2: f64 = (layer.meshes.iter())
        .flat_map(|mesh| {
            mesh.indices
                .as_chunks::<3>()
                .0
                .iter()
                .map(move |t| (mesh, t))
        })
        .filter(|(mesh, t)| mesh.features[t[0] as usize] == number)
        .map(|(mesh, t)| {
            let [a, b, c] = t.map(|k| mesh.vertex_m(k));
            (b - a).cross(c - a).z.max(0.0) / 2.0
        })
        .sum();
    assert!((lid_m2 - 3.0).abs() < 0.01, "{lid_m2}");
}

#[test]
fn records_that_ask_for_too_much_end() {
    // Each curve names the next one twice: 2^30 points.
    let mut text = String::from(
        "@1=IFCEXTRUDEDAREASOLID(@2,$,#8,1.);@2=IFCARBITRARYCLOSEDPROFILEDEF(.AREA.,$,@10);",
    );
    for k in 10..40 {
        let (next, segment) = (k + 1, k + 40);
        text += &format!(
            "@{k}=IFCCOMPOSITECURVE((@{segment},@{segment}),.F.);@{segment}=IFCCOMPOSITECURVESEGMENT(.CONTINUOUS.,.T.,@{next});"
        );
    }
    text +=
        "@40=IFCPOLYLINE((@90,@91));@90=IFCCARTESIANPOINT((0.,0.));@91=IFCCARTESIANPOINT((1.,0.));";
    let spline = "@1=IFCEXTRUDEDAREASOLID(@2,$,#8,1.);@2=IFCARBITRARYCLOSEDPROFILEDEF(.AREA.,$,@3);\
        @3=IFCBSPLINECURVEWITHKNOTS(2000000000,(@4,@5),.UNSPECIFIED.,.F.,.F.,(2000000001,2000000001),(0.,1.),.UNSPECIFIED.);\
        @4=IFCCARTESIANPOINT((0.,0.));@5=IFCCARTESIANPOINT((1.,0.));";
    for (odd, want) in [(spline, 1), (text.as_str(), 0)] {
        let text = file(
            METRES,
            MAP,
            &[("box", "@1=IFCBLOCK(#6,1.,1.,1.);"), ("odd", odd)],
        );
        match read_text(&text, &Options::default()) {
            Ok(layer) => assert_eq!(layer.features.len(), 1),
            Err(error) => assert!(
                want == 0 && error.to_string().contains("multiply"),
                "{error}"
            ),
        }
    }
}

#[test]
fn solids_of_other_kinds_have_their_volumes() {
    let circle = |r: f64| 16.0 * r * r * (TAU / 32.0).sin();
    let ring = "@2=IFCRECTANGLEPROFILEDEF(.AREA.,$,@3,1.,1.);@3=IFCAXIS2PLACEMENT2D(@4,$);@4=IFCCARTESIANPOINT((3.,0.));@5=IFCAXIS1PLACEMENT(#7,#9);";
    // A prism on edges: a triangle of 4 m by 3 m, 2 m high.
    let mut prism =
        String::from("@1=IFCADVANCEDBREP(@2);@2=IFCCLOSEDSHELL((@10,@20,@30,@40,@50));");
    let corners = [
        [0, 0, 0],
        [4, 0, 0],
        [4, 3, 0],
        [0, 0, 2],
        [4, 0, 2],
        [4, 3, 2],
    ];
    for (k, [x, y, z]) in corners.iter().enumerate() {
        prism += &format!(
            "@{}=IFCVERTEXPOINT(@{});@{}=IFCCARTESIANPOINT(({x}.,{y}.,{z}.));",
            60 + k,
            70 + k,
            70 + k
        );
    }
    prism += "@80=IFCPLANE(#6);@81=IFCLINE(#7,@82);@82=IFCVECTOR(#8,1.);";
    let loops: [&[usize]; 5] = [
        &[0, 2, 1],
        &[3, 4, 5],
        &[0, 1, 4, 3],
        &[1, 2, 5, 4],
        &[2, 0, 3, 5],
    ];
    let mut edge = 100;
    let mut edges = String::new();
    for (k, ring) in loops.iter().enumerate() {
        let n = 10 * (k + 1);
        let mut own = Vec::new();
        for (i, a) in ring.iter().enumerate() {
            let b = ring[(i + 1) % ring.len()];
            edges += &format!(
                "#{edge}=IFCORIENTEDEDGE(*,*,#{},.T.);#{}=IFCEDGECURVE(@{},@{},@81,.T.);",
                edge + 1,
                edge + 1,
                60 + a,
                60 + b
            );
            own.push(format!("#{edge}"));
            edge += 2;
        }
        prism += &format!(
            "@{n}=IFCADVANCEDFACE((@{}),@80,.T.);@{}=IFCFACEOUTERBOUND(@{},.T.);@{}=IFCEDGELOOP(({}));",
            n + 1,
            n + 1,
            n + 2,
            n + 2,
            own.join(",")
        );
    }
    let prism = prism + &edges;
    let taper = "@1=IFCEXTRUDEDAREASOLIDTAPERED(@2,$,#8,3.,@3);@2=IFCRECTANGLEPROFILEDEF(.AREA.,$,$,2.,2.);@3=IFCRECTANGLEPROFILEDEF(.AREA.,$,$,1.,1.);";
    let whole = format!("@1=IFCREVOLVEDAREASOLID(@2,$,@5,360.);{ring}");
    let quarter = format!("@1=IFCREVOLVEDAREASOLID(@2,$,@5,90.);{ring}");
    let layer = read_text(
        &file(METRES, MAP, &[
            ("block", "@1=IFCBLOCK(#6,2.,3.,4.)"),
            ("cylinder", "@1=IFCRIGHTCIRCULARCYLINDER(#6,5.,1.);"),
            ("csg", "@1=IFCCSGSOLID(@2);@2=IFCBOOLEANRESULT(.UNION.,@3,@4);@3=IFCBLOCK(#6,1.,1.,1.);@4=IFCBLOCK(#6,1.,1.,2.);"),
            ("ring", whole.as_str()),
            ("quarter", quarter.as_str()),
            ("prism", prism.as_str()),
            ("taper", taper),
("pipe", "@1=IFCSWEPTDISKSOLID(@2,1.,.5,$,$);@2=IFCPOLYLINE((@3,@4,@5));@3=IFCCARTESIANPOINT((0.,0.,0.));@4=IFCCARTESIANPOINT((10.,0.,0.));@5=IFCCARTESIANPOINT((10.,5.,5.));"),
("cone", "@1=IFCRIGHTCIRCULARCONE(#6,3.,1.);"),
("pyramid", "@1=IFCRECTANGULARPYRAMID(#6,2.,3.,4.);"),
        ].map(|(n, t)| (n, if t.ends_with(';') { t.to_string() } else { format!("{t};") })).iter().map(|(n, t)| (*n, t.as_str())).collect::<Vec<_>>()),
        &Options::default(),
    )
    .unwrap();
    assert!(
        !warnings(&layer).contains("left out"),
        "{}",
        warnings(&layer)
    );
    // A square of 1 m² turned at 3 m: Pappus' 2 pi r A, less by the chords of 32 corners.
    let turn = circle(1.0) / PI * TAU * 3.0;
    for (name, want) in [
        ("block", 24.0),
        ("cylinder", 5.0 * circle(1.0)),
        ("csg", 3.0),
        ("ring", turn),
        ("quarter", turn / 4.0),
        ("prism", 12.0),
        ("taper", 3.0 / 3.0 * (4.0 + 2.0 + 1.0)),
        // Of a 12-gon whose mitres leave the length.
        ("pipe", 3.0 * (1.0 - 0.25) * (10.0 + 50_f64.sqrt())),
        ("cone", circle(1.0)),
        ("pyramid", 8.0),
    ] {
        let found = volume_m3(&layer.meshes, Some(number(&layer, name)));
        let want = want / 0.9996_f64.powi(2);
        assert!(
            (found / want - 1.0).abs() < 2e-3,
            "{name}: {found} against {want}"
        );
    }
}

#[test]
fn what_is_not_read_is_counted_and_named() {
    let block = "@1=IFCBLOCK(#6,1.,1.,1.);";
    let text = file(
        METRES,
        MAP,
        &[
            ("good", block),
            (
                "egg",
                "@1=IFCEXTRUDEDAREASOLID(@2,$,#8,1.);@2=IFCCRANERAILASHAPEPROFILEDEF(.AREA.,$,$,1.,$,$,$,$,$,$,$,$);",
            ),
            ("pipe", "@1=IFCSURFACECURVESWEPTAREASOLID(@2,$,@3,$,$,@4);"),
            (
                "cut",
                "@1=IFCBOOLEANCLIPPINGRESULT(.DIFFERENCE.,@2,@3);@2=IFCBLOCK(#6,1.,1.,1.);@3=IFCBLOCK(#6,1.,1.,1.);",
            ),
            (
                "curved",
                "@1=IFCADVANCEDBREP(@2);@2=IFCCLOSEDSHELL((@3));@3=IFCADVANCEDFACE((@4),@5,.T.);@5=IFCCYLINDRICALSURFACE(#6,1.);",
            ),
            ("nothing there", "@2=IFCBLOCK(#6,1.,1.,1.);"),
            ("no height", "@1=IFCBLOCK(#6,1.,1.,0.);"),
        ],
    );
    let more = "#300=IFCWALL('w',$,'Bare',$,$,#10,$,$,$);\n#301=IFCOPENINGELEMENT('o',$,'Hole',$,$,#10,$,$,$);\n\
        #302=IFCANNOTATION('n',$,'Note',$,$,#10,$);\n#303=IFCSITE('s',$,'Site',$,$,#10,$,$,$,$,$,$,$,$);\n\
        #304=IFCWALL('x',$,'Lost',$,$,#999,#1901,$,$);\n#305=IFCSTAIR('st',$,'Whole',$,$,#10,$,$,$);\n\
        #306=IFCRELAGGREGATES('a',$,$,$,#305,(#1000));\n#307=IFCWALL('y',$,'Axis',$,$,#10,#308,$,$);\n\
        #308=IFCPRODUCTDEFINITIONSHAPE($,$,(#309));\n#309=IFCSHAPEREPRESENTATION(#5,'Axis','Curve2D',(#1001));\n\
        #310=IFCWALL('z',$,'Grid',$,$,#311,#1901,$,$);\n#311=IFCGRIDPLACEMENT($,$,$);\nENDSEC;\nEND-";
    let layer = read_text(&text.replace("ENDSEC;\nEND-", more), &Options::default()).unwrap();
    let said = warnings(&layer);
    for part in [
        "1 IfcCraneRailAShapeProfileDef profiles (#2002 in IfcBeam 'egg')",
        "1 IfcSurfaceCurveSweptAreaSolid shape items",
        "1 cuts of Boolean operations",
        "1 IfcCylindricalSurface faces of curved B-reps",
        "1 shape items that are missing or damaged (#6001 in IfcBeam 'nothing there')",
        "1 damaged IfcBlock records",
        "1 products without a shape (#300 IfcWall)",
        "1 openings (walls and slabs stay uncut)",
        "1 annotations",
        "damaged IfcWall records",
        "1 products without a body (#307 with Axis",
        "1 IfcGridPlacement placements",
    ] {
        assert!(said.contains(part), "{part} is not in {said}");
    }
    // One line for all; good and cut stay.
    assert_eq!(
        said.lines()
            .filter(|line| line.contains("left out"))
            .count(),
        1,
        "{said}"
    );
    assert_eq!(layer.features.len(), 2, "{:?}", layer.features);
}

#[test]
fn one_damaged_record_does_not_cost_the_file() {
    let block = "@1=IFCBLOCK(#6,1.,1.,1.);";
    let far = "@1=IFCBLOCK(@2,1.,1.,1.);@2=IFCAXIS2PLACEMENT3D(@3,$,$);@3=IFCCARTESIANPOINT((9.E9,0.,0.));";
    let flat = "@1=IFCTRIANGULATEDFACESET(@2,$,.T.,((1,2,3),(1,2,9)),$);@2=IFCCARTESIANPOINTLIST3D(((0.,0.,0.),(1.,0.,0.),(1.,0.,0.)));";
    let text = file(
        METRES,
        MAP,
        &[("one", block), ("two", block), ("far", far), ("flat", flat)],
    );
    let odd = "#400=IFCWALL('x',$,'cut off',$,$,#10,#1901,$,$\n#401=IFCWALL('x',$,'twice',$,$,#10,#1901,$,$);\n\
        #401=IFCWALL('x',$,'twice',$,$,#10,#1901,$,$);\n#4294967999=IFCWALL('x',$,'large',$,$,#10,#1901,$,$);\nENDSEC;\nEND-";
    let layer = read_text(&text.replace("ENDSEC;\nEND-", odd), &Options::default()).unwrap();
    let said = warnings(&layer);
    for part in [
        "1 products a hundred kilometres from the rest (IfcBeam 'far')",
        "1 products whose faces have no area (IfcBeam 'flat')",
        "1 faces of sets with points that do not exist (#4001 in IfcBeam 'flat')",
        "1 damaged records (line ",
        "1 records whose number is taken (#401)",
        "1 records with numbers above 4294967295 (line ",
    ] {
        assert!(said.contains(part), "{part} is not in {said}");
    }
    let names: Vec<_> = layer
        .features
        .iter()
        .filter_map(|known| known["name"].as_str())
        .collect();
    assert_eq!(names, ["twice", "one", "two"]);
}

#[test]
fn marks_and_archives_are_told_apart() {
    let text = file(METRES, MAP, &[("block", "@1=IFCBLOCK(#6,1.,1.,1.);")]);
    for text in [
        format!("\u{feff}{text}"),
        text.replace('\n', "\r\n"),
        format!("\n\n {text}\n"),
        text.replace("#5=IFC", "/* the context; #99=IFCWALL( */\n#5=IFC"),
    ] {
        assert_eq!(
            read_text(&text, &Options::default())
                .unwrap()
                .features
                .len(),
            1
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ifc");
    for (bytes, word) in [
        (b"PK\x03\x04".to_vec(), "ZIP archive"),
        (b"<?xml version=\"1.0\"?>".to_vec(), "ifcXML"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let said = super::read(&path, &Options::default())
            .unwrap_err()
            .to_string();
        assert!(said.contains(word), "{said}");
    }
}
