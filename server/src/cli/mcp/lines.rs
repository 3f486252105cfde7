//! Lines between the client and the protocol's own reader, which drops what is no JSON: here it is answered, as
//! JSON-RPC asks, so that no client waits without end.

use serde_json::{Value, json};
use std::sync::Arc;
use tokio::io::{AsyncBufRead, AsyncBufReadExt, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::Mutex;

/// A longer line is no message.
const MOST_LINE: u64 = 16 << 20;
/// JSON-RPC's codes of what is no JSON, and of what is JSON but no message.
const NO_JSON: i32 = -32700;
const NO_MESSAGE: i32 = -32600;

/// Where lines go, one at a time.
pub type Output<W> = Arc<Mutex<W>>;

/// Passes messages on to the reader, and answers other lines, until there are no more.
pub async fn pass_in<R, W, S>(mut input: R, answers: Output<W>, mut server: S) -> std::io::Result<()>
where
    R: AsyncBufRead + Unpin,
    W: AsyncWrite + Unpin,
    S: AsyncWrite + Unpin,
{
    let mut line = Vec::new();
    loop {
        line.clear();
        if (&mut input).take(MOST_LINE).read_until(b'\n', &mut line).await? == 0 {
            return server.shutdown().await;
        }
        let is_whole = line.ends_with(b"\n") || (line.len() as u64) < MOST_LINE;
        let answer =
            if is_whole { answer(&line) } else { Some(error(NO_MESSAGE, "the line is too long", Value::Null)) };
        match answer {
            Some(answer) => write_line(&answers, answer.to_string().as_bytes()).await?,
            None => server.write_all(&line).await?,
        }
        while !is_whole && !line.ends_with(b"\n") {
            line.clear();
            if (&mut input).take(MOST_LINE).read_until(b'\n', &mut line).await? == 0 {
                return server.shutdown().await;
            }
        }
    }
}

/// Passes the server's answers on. An error that belongs to no request says so.
pub async fn pass_out<R, W>(mut server: R, output: Output<W>) -> std::io::Result<()>
where
    R: AsyncBufRead + Unpin,
    W: AsyncWrite + Unpin,
{
    let mut line = Vec::new();
    while server.read_until(b'\n', &mut line).await? > 0 {
        if let Ok(Value::Object(mut message)) = serde_json::from_slice(&line)
            && message.contains_key("error")
            && !message.contains_key("id")
        {
            message.insert("id".into(), Value::Null);
            line = Value::Object(message).to_string().into_bytes();
        }
        write_line(&output, &line).await?;
        line.clear();
    }
    Ok(())
}

async fn write_line<W: AsyncWrite + Unpin>(output: &Output<W>, line: &[u8]) -> std::io::Result<()> {
    let mut output = output.lock().await;
    output.write_all(line.strip_suffix(b"\n").unwrap_or(line)).await?;
    output.write_all(b"\n").await?;
    output.flush().await
}

/// The answer to a line that is no message.
fn answer(line: &[u8]) -> Option<Value> {
    if line.iter().all(u8::is_ascii_whitespace) {
        return None;
    }
    let message = match serde_json::from_slice::<Value>(line) {
        Ok(message) => message,
        Err(why) => return Some(error(NO_JSON, &format!("the line is no JSON: {why}"), Value::Null)),
    };
    let is_message = message["jsonrpc"] == "2.0"
        && (message["method"].is_string() || message.get("result").is_some() || message.get("error").is_some());
    let id = message.get("id").filter(|id| id.is_string() || id.is_number()).cloned();
    (!is_message).then(|| error(NO_MESSAGE, "the line is no message of JSON-RPC 2.0", id.unwrap_or_default()))
}

fn error(code: i32, message: &str, id: Value) -> Value {
    json!({ "jsonrpc": "2.0", "id": id, "error": { "code": code, "message": message } })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_message_is_answered() {
        let said =
            |line: &str| answer(line.as_bytes()).map(|answer| (answer["error"]["code"].clone(), answer["id"].clone()));
        let message = "{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"ping\"}";
        assert!(said(message).is_none() && said(" \n").is_none());
        for broken in ["{", &message[..message.len() - 1], "{\"jsonrpc\":\"2.0\",\"id\":1,}", "\u{feff}", "hello"] {
            assert_eq!(said(broken), Some((json!(NO_JSON), Value::Null)), "{broken}");
        }
        for other in ["[]", "42", "{\"jsonrpc\":\"2.0\"}", "{\"method\":\"ping\"}"] {
            assert_eq!(said(other), Some((json!(NO_MESSAGE), Value::Null)), "{other}");
        }
        assert_eq!(said("{\"id\":\"seven\"}"), Some((json!(NO_MESSAGE), json!("seven"))));
    }

    #[tokio::test]
    async fn lines_go_both_ways_and_errors_have_an_id() {
        let output: Output<Vec<u8>> = Arc::default();
        let mut server = std::io::Cursor::new(Vec::new());
        let input = b"{bad\n{\"jsonrpc\":\"2.0\",\"method\":\"ping\"}\n".as_slice();
        pass_in(input, output.clone(), &mut server).await.unwrap();
        assert_eq!(server.into_inner(), b"{\"jsonrpc\":\"2.0\",\"method\":\"ping\"}\n");
        let answers = b"{\"jsonrpc\":\"2.0\",\"error\":{\"code\":1}}\n{\"id\":2,\"result\":{}}\n".as_slice();
        pass_out(answers, output.clone()).await.unwrap();
        let text = String::from_utf8(output.lock().await.clone()).unwrap();
        let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert!(lines.len() == 3 && lines[0]["error"]["code"] == NO_JSON && lines[1].get("id") == Some(&Value::Null));
        assert_eq!(lines[2], json!({ "id": 2, "result": {} }));
    }
}
