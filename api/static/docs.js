// The reference of the interface, drawn by Swagger UI from our own document.
SwaggerUIBundle({ url: "/openapi.json", dom_id: "#reference", deepLinking: true, defaultModelsExpandDepth: -1 });
