//! What a model costs: its parameters and the floating-point operations of a picture.

use crate::inference::{DetectorError, environment, first_line};
use ort::session::{Session, builder::GraphOptimizationLevel};
use ort::value::TensorRef;
use prost::Message;
use serde_json::Value;
use std::path::Path;

/// The parts of `onnx.proto` (ONNX IR version 3 on) that parameters stand in.
#[derive(Clone, PartialEq, Message)]
struct Model {
    #[prost(message, optional, tag = "7")]
    graph: Option<Graph>,
}

#[derive(Clone, PartialEq, Message)]
struct Graph {
    #[prost(message, repeated, tag = "5")]
    initializer: Vec<Tensor>,
}

#[derive(Clone, PartialEq, Message)]
struct Tensor {
    #[prost(int64, repeated, tag = "1")]
    dims: Vec<i64>,
    #[prost(int32, tag = "2")]
    data_type: i32,
}

/// `TensorProto.DataType` of weights: f32, u8, i8, f16, f64, bf16. Wider integers are shapes and
/// indices.
const WEIGHTS: [i32; 6] = [1, 2, 3, 10, 11, 16];

/// Number of parameters in the text of an ONNX file: the elements of all initialisers that are
/// floating-point or 8-bit; `None` if it is no ONNX file.
pub fn parameters(onnx: &[u8]) -> Option<u64> {
    let graph = Model::decode(onnx).ok()?.graph?;
    let elements = |tensor: &Tensor| {
        (tensor.dims.iter()).try_fold(1_u64, |product, &dim| {
            product.checked_mul(u64::try_from(dim).ok()?)
        })
    };
    (graph.initializer.iter())
        .filter(|tensor| WEIGHTS.contains(&tensor.data_type))
        .try_fold(0_u64, |sum, tensor| sum.checked_add(elements(tensor)?))
}

/// Operations of one picture of `size_px`, in 10⁹: two for each multiply and add of convolutions
/// and matrix products, nothing for the rest. Shapes are those of one run of ONNX Runtime without
/// its optimisations, so that models of any input size are counted; its profile goes to
/// `scratch`, a folder that is made and removed.
pub fn gflops(path: &Path, size_px: [u32; 2], scratch: &Path) -> Result<f64, DetectorError> {
    let broken = |why: String| DetectorError::Broken {
        path: path.into(),
        why: first_line(&why),
    };
    let profiled = || -> Result<String, Box<dyn std::error::Error>> {
        std::fs::create_dir_all(scratch)?;
        Ok(std::fs::read_to_string(run(path, size_px, scratch)?)?)
    };
    let text = profiled();
    // Not a result; if it stays behind no harm is done.
    let _ = std::fs::remove_dir_all(scratch);
    let events: Value = serde_json::from_str(&text.map_err(|error| broken(error.to_string()))?)
        .map_err(|error| broken(error.to_string()))?;
    let nodes = events.as_array().map_or(&[][..], Vec::as_slice);
    let flops: Option<f64> = (nodes.iter())
        .filter(|event| event["cat"] == "Node" && event["args"]["output_type_shape"].is_array())
        .map(|event| operations(&event["args"]))
        .sum();
    flops
        .map(|flops| 1e-9 * flops)
        .ok_or_else(|| broken("ONNX Runtime's profile lacks the shape of a product".into()))
}

/// One grey picture with profiling; gives the profile's file.
fn run(
    path: &Path,
    size_px: [u32; 2],
    scratch: &Path,
) -> Result<String, Box<dyn std::error::Error>> {
    let [width, height] = size_px.map(|side| side as usize);
    let mut session = Session::builder(environment()?)?
        .with_optimization_level(GraphOptimizationLevel::Disable)
        .map_err(|error| error.to_string())?
        .with_profiling(scratch.join("profile"))
        .map_err(|error| error.to_string())?
        .commit_from_file(path)
        .map_err(|error| error.to_string())?;
    let planes = vec![0.5_f32; 3 * width * height];
    let image = TensorRef::from_array_view(([1, 3, height, width], &planes[..]))?;
    session.run(ort::inputs!["image" => image])?;
    Ok(session.end_profiling()?)
}

/// Operations of one node of the profile, of which other nodes than products have none; `None`
/// without the shapes that a product needs.
fn operations(node: &Value) -> Option<f64> {
    let shape = |list: &Value, index: usize| -> Option<Vec<f64>> {
        let (_, dims) = list.get(index)?.as_object()?.iter().next()?;
        dims.as_array()?.iter().map(Value::as_f64).collect()
    };
    let name = node["op_name"].as_str()?;
    let (inputs, outputs) = (&node["input_type_shape"], &node["output_type_shape"]);
    let all = |dims: &[f64]| dims.iter().product::<f64>();
    let multiplies = match name {
        "Conv" => {
            let weight = shape(inputs, 1)?;
            all(&shape(outputs, 0)?) * all(weight.get(1..)?)
        }
        "ConvTranspose" => {
            let weight = shape(inputs, 1)?;
            all(&shape(inputs, 0)?) * all(weight.get(1..)?)
        }
        "MatMul" => all(&shape(outputs, 0)?) * shape(inputs, 0)?.last()?,
        "Gemm" => {
            let out = shape(outputs, 0)?;
            all(&shape(inputs, 0)?) * out.get(1)?
        }
        _ => 0.0,
    };
    Some(2.0 * multiplies)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn weights_are_counted_and_indices_are_not() {
        let tensor = |dims: &[i64], data_type| Tensor {
            dims: dims.to_vec(),
            data_type,
        };
        let model = Model {
            graph: Some(Graph {
                initializer: vec![
                    tensor(&[16, 3, 3, 3], 1),
                    tensor(&[16], 10),
                    tensor(&[4], 7),
                    tensor(&[], 1),
                ],
            }),
        };
        assert_eq!(parameters(&model.encode_to_vec()), Some(432 + 16 + 1));
        assert_eq!(parameters(b"no model"), None);
    }

    #[test]
    fn products_cost_two_operations_for_each_multiply() {
        let node = |name: &str, inputs: Value, outputs: Value| {
            operations(
                &json!({"op_name": name, "input_type_shape": inputs, "output_type_shape": outputs}),
            )
        };
        // 3 × 3 kernel over 8 channels to 16 on 10 × 20 px, then by two groups.
        let image = json!({"float": [1, 8, 10, 20]});
        let out = json!([{"float": [1, 16, 10, 20]}]);
        let conv = |weight: Value| node("Conv", json!([image, weight]), out.clone());
        assert_eq!(
            conv(json!({"float": [16, 8, 3, 3]})),
            Some(2.0 * 16.0 * 200.0 * 72.0)
        );
        assert_eq!(
            conv(json!({"float": [16, 4, 3, 3]})),
            Some(2.0 * 16.0 * 200.0 * 36.0)
        );
        assert_eq!(node("Conv", json!([]), out.clone()), None);
        let a = json!({"float": [2, 5, 7]});
        let b = json!({"float": [7, 3]});
        let product = node("MatMul", json!([a, b]), json!([{"float": [2, 5, 3]}]));
        assert_eq!(product, Some(2.0 * 30.0 * 7.0));
        let a = json!({"float": [5, 7]});
        let product = node("Gemm", json!([a, b]), json!([{"float": [5, 3]}]));
        assert_eq!(product, Some(2.0 * 15.0 * 7.0));
        let deconv = node(
            "ConvTranspose",
            json!([image, {"float": [8, 4, 2, 2]}]),
            json!([{"float": [1, 4, 20, 40]}]),
        );
        assert_eq!(deconv, Some(2.0 * 1600.0 * 16.0));
        assert_eq!(node("Relu", json!([image]), out), Some(0.0));
    }
}
